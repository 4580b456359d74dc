# Cython types of levels.py, which also runs uncompiled (decision 0037).

cimport cython

from common.elementary cimport decay

cdef double _MISSING_SHARE, _MISSING_MOST, _SHAKEN_SHARE

cdef class Levels:
    cdef double _gain, _at_rest, _unknown_side_share, _now
    cdef double[::1] _contact, _collision, _per_speed, _coulomb, _has_gap
    cdef readonly double[::1] share, crossing, contact, collision, above, begin, friction, raised

    cpdef void set_friction(
        self, Py_ssize_t i, double rest, double unknown, double factor, double load
    ) noexcept
    cpdef double friction_at(
        self, Py_ssize_t i, double rest, double unknown, double factor, double load
    ) noexcept
    cpdef void integrate(self, Py_ssize_t i, double dt, double pole, double share) noexcept
    cpdef void end(self, Py_ssize_t i) noexcept
    @cython.locals(share=double, needed=double)
    cpdef double uncertainty(
        self, Py_ssize_t i, bint unknown, bint crossing, bint shaken, double periods
    ) noexcept
    @cython.locals(grown=double)
    cpdef double put_in_force(
        self, Py_ssize_t i, double learning, double uncertainty, double speed, double dt
    ) noexcept
    @cython.locals(grown=double)
    cpdef void add_up(self, Py_ssize_t i, double learning, double speed) noexcept
    cpdef double contact_at(self, Py_ssize_t i, double above) noexcept
    cpdef double configured(self, Py_ssize_t i, double speed) noexcept
    cpdef void reset(self, Py_ssize_t i) noexcept
