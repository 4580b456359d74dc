# Types of guide_spring.py, for the compiler alone.

cimport cython

cdef extern from "math.h":
    cpdef double sqrt(double x) noexcept

cdef Py_ssize_t _DAMPED, _STIFF
cdef double _ARM_M, _SPRING_M_S, _SLIP_M, _WHOLE_N, _BLOCKS_N, _NONE_N, _OFF_M, _BLOCKED_S, _PRESSES_N

cdef class GuideSpring:
    cdef double _rate
    cdef long long[::1] _set
    cdef readonly long long[::1] kind
    cdef readonly double[::1] off
    cdef double[::1] back, _blocked_s, _d, _x
    cdef double[:, ::1] _N

    cdef void begin(self, double[::1] x, double[:, ::1] M) noexcept
    @cython.locals(off=double, kept=double, one=double, n0=double, n1=double, n2=double, b=Py_ssize_t, c=Py_ssize_t)
    cdef void measure(self, double[::1] x, double[:, ::1] G, double[:, ::1] M, bint hand) noexcept
    cdef void _stiffen(self) noexcept
    @cython.locals(against=double, blocked=bint, gave=bint, b=Py_ssize_t)
    cdef void withstand(self, Py_ssize_t a, double force, double dt) noexcept
