# C types of links.py, read by the compiler only.

from common.elementary cimport cosine, sine

cdef class Links:
    cdef readonly Py_ssize_t n
    cdef readonly double[::1] gravity
    cdef long long[::1] _parent, _slides
    cdef double[:, :, ::1] _fixed, _sine, _versine, _inertia, _R
    cdef double[:, ::1] _sliding, _turning, _offset, _lever
    cdef double[:, ::1] _p, _z, _s, _w, _wd, _a, _F, _N, _h, _J, _M, _turned
    cdef double[::1] _mass, _m, _bias

    cpdef void load(
        self, Py_ssize_t i, double mass, double[::1] lever, double[:, ::1] inertia
    ) noexcept
    cpdef void accelerate(
        self, double[::1] q, double[::1] q_dot, double[::1] tau, double[::1] out
    ) noexcept
    cdef void _pose(self, Py_ssize_t i, double q, double q_dot) noexcept
    cdef void _body(self, Py_ssize_t i) noexcept
    cdef void _carry(self, Py_ssize_t i) noexcept
    cdef void _solve(self, double[::1] x) noexcept
