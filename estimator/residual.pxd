# Cython types of residual.py, which also runs uncompiled (decision 0037).

cimport cython

cdef double _SHORTEST_S
cdef Py_ssize_t _TERMS

cdef class Residual:
    cdef double _gain
    cdef readonly double pole, share
    cdef Py_ssize_t _variants
    cdef double[:, ::1] _always, _engaged
    cdef double[::1] _corrected
    cdef readonly double[:, ::1] values, corrected

    @cython.locals(e=double, engaged=double, pole=double, share=double)
    cpdef void step(
        self, Py_ssize_t i, double[::1] impulse, double spring, bint touched, double dt
    ) noexcept
    cpdef void correct(self, Py_ssize_t i, double correction) noexcept
    cpdef void reset(self, Py_ssize_t i) noexcept
    @cython.locals(total=double)
    cpdef double sum(self, Py_ssize_t i) noexcept
