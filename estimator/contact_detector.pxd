# Cython types of contact_detector.py, which also runs uncompiled (decision 0037).

cimport cython

from estimator.levels cimport Levels

cdef double _CLEAR, _ABSENT
cdef long long _WAITS

cdef class ContactDetector:
    cdef Py_ssize_t _n
    cdef object _joints
    cdef readonly Levels levels
    cdef long long _debounce
    cdef readonly long long[:, ::1] streak, waited, begins

    @cython.locals(
        begun="long long", past="long long", streak="long long", begins=bint
    )
    cpdef long long step(self, Py_ssize_t i, double residual, bint arrived, bint waits) noexcept
    @cython.locals(clear=double, beyond=double)
    cpdef Py_ssize_t touched_link(self, double[::1] residual) noexcept
    cpdef void reset(self, Py_ssize_t i) noexcept
