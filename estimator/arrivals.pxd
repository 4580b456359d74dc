# Cython types of arrivals.py, which also runs uncompiled (decision 0037).

cimport cython

from estimator.link_velocity cimport Alignment

cdef Py_ssize_t _SAMPLES
cdef long long _LATE, _RESTARTED, _BRIDGED, _RAISED, _STARTING
cdef double _SENSED_PERIODS, _LATE_PERIODS, _RAISED_PERIODS, _BRIDGED_PERIODS

cdef class Arrivals:
    cdef Alignment _alignment
    cdef Py_ssize_t _n
    cdef double _period
    cdef readonly long long[::1] arrived
    cdef readonly double[::1] since, gaps

    @cython.locals(everything=double)
    cpdef bint tick(self, double dt) noexcept
    cpdef double step(self, double dt) noexcept
    @cython.locals(flags="long long")
    cpdef long long gap(self, Py_ssize_t i) noexcept
    @cython.locals(ready=bint, counted=bint)
    cpdef long long starting(self) noexcept
    cpdef bint late(self, Py_ssize_t i) noexcept
    cpdef long long raised(self, Py_ssize_t i) noexcept
    cpdef bint bridged(self, Py_ssize_t i) noexcept
    cpdef bint senses(self, Py_ssize_t i) noexcept
