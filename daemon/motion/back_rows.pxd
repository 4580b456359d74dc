# Types of back_rows.py, for the compiler alone.

cimport cython

cdef extern from "math.h":
    cpdef double sqrt(double x) noexcept

cdef double _RIGID, _TINY, _FLAT, _REACH

cdef class BackRows:
    cdef Py_ssize_t _n
    cdef double[:, ::1] A, _S
    cdef double[::1] c, goal, ahead, back, y

    @cython.locals(mean=double, least=double, flat=double, beyond=double)
    cdef double factor(self, Py_ssize_t rows, const double[:] gain) noexcept
    cdef void ask(self, Py_ssize_t rows, const double[:] v) noexcept
    cdef void push(
        self, Py_ssize_t rows, const double[:] gain, double[::1] ahead, double[::1] out
    ) noexcept
