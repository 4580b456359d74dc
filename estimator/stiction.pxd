# Cython types of stiction.py, which also runs uncompiled (decision 0037).

cimport cython

cdef double CREEP, LINK_REST
cdef Py_ssize_t _BELIEFS

cpdef double displacement(
    double theta_dot, double q_dot, double moved, bint has_gap, double dt
) noexcept

cdef class Stiction:
    cdef double[::1] _per_presliding, _least, _most
    cdef readonly double[:, :, ::1] ends
    cdef readonly double[::1] held, unknown

    cpdef void restart(self, Py_ssize_t i) noexcept
    cpdef double unknown_at_rest(self, Py_ssize_t i) noexcept
    @cython.locals(low=double, high=double, lowest=double, highest=double, way=double)
    cpdef void step(self, Py_ssize_t i, double displacement, double sign) noexcept
