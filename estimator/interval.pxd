# Cython types of interval.py, which also runs uncompiled (decision 0037).

cdef Py_ssize_t _TERMS, _INCREMENTS

cdef class Interval:
    cdef readonly double[:, ::1] begin
    cdef readonly double[::1] now, impulse

    cpdef void integrate(self, Py_ssize_t i, double dt) noexcept
    cpdef void end(self, Py_ssize_t i) noexcept
    cpdef void restart(self, Py_ssize_t i) noexcept
