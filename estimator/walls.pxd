# Cython types of walls.py, which also runs uncompiled (decision 0037).

cimport cython

from estimator.clearance cimport Clearance

cdef extern from "math.h":
    cpdef double sqrt(double x) noexcept

cdef Py_ssize_t _SWEEPS
cdef double _SLOWS, _TINY, _UNKNOWN

cdef class Walls:
    cdef readonly Clearance clearance
    cdef readonly Py_ssize_t nearest
    cdef readonly double distance
    cdef readonly bint slows
    cdef double[::1] _acceleration, _most, _moved, _room, _deepest, _floor
    cdef long long[::1] _active
    cdef double _reaction_s, _margin
    cdef bint _anew

    @cython.locals(c=Clearance, known=double, moves=double, active=Py_ssize_t, over=bint)
    cpdef void bound(
        self, const double[:] q, const double[:] moved, const double[:] wanted,
        const double[:, :] play, double[::1] out
    ) noexcept
    cpdef void forget(self) noexcept
    @cython.locals(c=Clearance, active=Py_ssize_t, closing=double, used=double, gap=double,
                   g=double, most=double)
    cdef Py_ssize_t _too_fast(self, const double[:, :] play, double[::1] out) noexcept
    @cython.locals(c=Clearance, g=double, pair=Py_ssize_t, sinks=double, now=double)
    cdef void _measure(self, const double[:, :] play) noexcept
    @cython.locals(slack=double)
    cdef double _funnel(self, double gap, double A) noexcept
    @cython.locals(c=Clearance, slowed=bint, over=double, square=double, g=double, v=double)
    cdef bint _slow(self, Py_ssize_t row, double most, double[::1] out) noexcept
    @cython.locals(closing=double, g=double, v=double)
    cdef double _closing(self, Py_ssize_t row, double[::1] out) noexcept
    @cython.locals(share=double, closing=double, most=double)
    cdef void _fulfil(self, Py_ssize_t active, double[::1] out) noexcept
