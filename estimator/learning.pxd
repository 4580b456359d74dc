# Types of learning.py, for the compiler alone.

cimport cython

cdef Py_ssize_t _CONSTANT, _MOTOR, _VISCOUS, _COULOMB, _COLUMNS
cdef double _FORGETS_S, _TRUSTED_S, _NOISE, _OFF, _REMAINS, _FREEZES, _FROZEN_S
cdef double _OF_RMS, _RMS_S, _AT_FIRST_S, _OF_PEAK, _PEAK_S, _OF_CROSSING, _CROSSING_S, _CROSSING, _LASTS_S, _LEAST_LEVEL, _AHEAD

cdef class Learning:
    cdef double _forgets
    cdef double[:, ::1] _prior
    cdef double[::1] _bound
    cdef readonly double[:, :, ::1] information
    cdef readonly double[:, ::1] evidence, columns, shares
    cdef readonly double[::1] coulomb_left, viscous_left, quiet_s, loud_s, correction, unknown
    cdef readonly double[::1] squares_s, moved_s, peak, crossing_peak, peak_seen, crossing_seen
    cdef double[:, ::1] _L
    cdef double[::1] _D, _x

    cpdef void reset(self, Py_ssize_t i) noexcept
    @cython.locals(share=double, ahead=double)
    cpdef double level(self, Py_ssize_t i) noexcept
    cpdef double crossing_level(self, Py_ssize_t i) noexcept
    cpdef double friction(self, Py_ssize_t i) noexcept
    cpdef double error(self, Py_ssize_t i) noexcept
    cpdef double unknown_at(self, Py_ssize_t i, double coulomb, double viscous) noexcept
    cpdef void step(
        self, Py_ssize_t i, double coulomb, double viscous, double motor, double dt, double pole,
        double share
    ) noexcept
    @cython.locals(size=double, needed=double, quiet=bint)
    cpdef void learn(
        self, Py_ssize_t i, double residual, double level, double usual, double friction, double raised,
        bint moving, double dt
    ) noexcept
    @cython.locals(fade=double)
    cdef void _measure(self, Py_ssize_t i, double size, double needed, double dt) noexcept
    @cython.locals(fade=double)
    cdef void _fit(self, Py_ssize_t i, double residual, double dt) noexcept
    cdef void _forget(self, Py_ssize_t i) noexcept
    @cython.locals(value=double, coulomb=double, viscous=double, lever=double)
    cdef bint _solve(self, Py_ssize_t i) noexcept
