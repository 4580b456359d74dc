# Cython types of dynamics.py, which also runs uncompiled (decision 0037).

cimport cython

from common.elementary cimport cosine, sine

cdef class Dynamics:
    cdef readonly Py_ssize_t n
    cdef readonly double[::1] momentum, beta
    cdef long long[::1] _parent, _row
    cdef double[:, :, ::1] _fixed, _sine, _versine, _inertia, _R
    cdef double[:, ::1] _offset, _slide, _turning, _sliding, _moment, _own
    cdef double[:, ::1] _t, _v, _w, _g, _L, _K, _c
    cdef double[::1] _mass, _beyond, _load

    @cython.locals(square=double)
    cpdef void carry(self, Py_ssize_t i, double mass, double x, double y, double z) noexcept
    cpdef void at(self, double[::1] q, double[::1] q_dot) noexcept
    cdef void _outward(self, Py_ssize_t i, double q, double q_dot) noexcept
    cdef void _inward(self, Py_ssize_t i) noexcept
