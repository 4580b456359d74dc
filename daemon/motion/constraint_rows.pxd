# Types of constraint_rows.py, for the compiler alone.

cimport cython

cdef extern from "math.h":
    cpdef double sqrt(double x) noexcept

cdef double _RIGID, _TINY, _FLAT, _REACH

cdef class ConstraintRows:
    cdef Py_ssize_t _n
    cdef double[:, ::1] A, _S
    cdef double[::1] c, goal, excess, spring, force

    @cython.locals(mean=double, least=double, flat=double, beyond=double)
    cdef double factor(self, Py_ssize_t rows, const double[:] gain) noexcept
    cdef void measure_excess(self, Py_ssize_t rows, const double[:] v) noexcept
    cdef void correction(
        self, Py_ssize_t rows, const double[:] gain, double[::1] velocity, double[::1] out
    ) noexcept
