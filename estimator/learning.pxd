# Types of learning.py, for the compiler alone.

cimport cython

cdef Py_ssize_t _CONSTANT, _MOTOR, _VISCOUS, _COULOMB, _COLUMNS
cdef double _FORGETS_S, _TRUSTED_S, _NOISE, _OFF, _REMAINS, _FREEZES, _FROZEN_S, _MOVING

cdef class Learning:
    cdef double _forgets
    cdef double[:, ::1] _prior
    cdef double[::1] _bound
    cdef readonly double[:, :, ::1] information
    cdef readonly double[:, ::1] evidence, columns, shares
    cdef readonly double[::1] coulomb_left, viscous_left, quiet_s, correction, unknown
    cdef double[:, ::1] _L
    cdef double[::1] _D, _x

    cpdef void reset(self, Py_ssize_t i) noexcept
    cpdef double friction(self, Py_ssize_t i) noexcept
    cpdef double error(self, Py_ssize_t i) noexcept
    cpdef void step(
        self, Py_ssize_t i, double coulomb, double viscous, double motor, double dt, double pole,
        double share
    ) noexcept
    @cython.locals(fade=double)
    cpdef void learn(
        self, Py_ssize_t i, double residual, double level, double theta_dot, bint touched, double dt
    ) noexcept
    cdef void _forget(self, Py_ssize_t i) noexcept
    @cython.locals(value=double, coulomb=double, viscous=double, lever=double)
    cdef bint _solve(self, Py_ssize_t i) noexcept
