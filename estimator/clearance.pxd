# Cython types of clearance.py, which also runs uncompiled (decision 0037).

cimport cython

from common.elementary cimport cosine, sine

cdef extern from "math.h":
    cpdef double sqrt(double x) noexcept

cdef Py_ssize_t _CAPSULE, _PLANE, _BOX, _HALVINGS
cdef double _BESIDE, _TINY

cdef class Clearance:
    cdef readonly Py_ssize_t n
    cdef readonly object pairs
    cdef readonly long long[::1] pair, whole
    cdef readonly double[::1] gap, least
    cdef readonly double[:, ::1] gradient
    cdef long long[::1] _parent, _row, _body, _kind, _first, _second
    cdef double[:, :, ::1] _fixed, _sine, _versine, _R, _local, _segment, _axes
    cdef double[:, ::1] _offset, _turning, _sliding, _p, _w, _s, _plane, _centre, _half
    cdef double[::1] _radius, _x, _y, _normal, _lower

    @cython.locals(row=Py_ssize_t, k=Py_ssize_t)
    cpdef void at(self, const double[:] q) noexcept
    @cython.locals(parent=Py_ssize_t, s=double, versine=double, turned=double)
    cdef void _outward(self, Py_ssize_t i, double q) noexcept
    @cython.locals(i=Py_ssize_t)
    cdef void _place(self, Py_ssize_t k) noexcept
    @cython.locals(height=double)
    cdef Py_ssize_t _beside_plane(self, Py_ssize_t row, Py_ssize_t k, Py_ssize_t m) noexcept
    @cython.locals(t=double, distance=double)
    cdef Py_ssize_t _beside_box(self, Py_ssize_t row, Py_ssize_t k, Py_ssize_t m) noexcept
    @cython.locals(low=double, high=double, middle=double)
    cdef double _nearest_to_box(self, Py_ssize_t k, Py_ssize_t m) noexcept
    @cython.locals(low=double, high=double, lean="double[::1]")
    cdef void _lean(self, Py_ssize_t k, Py_ssize_t m, double t) noexcept
    @cython.locals(slope=double)
    cdef double _slope(self, Py_ssize_t k, Py_ssize_t m, double t) noexcept
    @cython.locals(outside=double, deepest=double, face=Py_ssize_t, along=double, beyond=double,
                   distance=double)
    cdef double _from_box(self, Py_ssize_t k, Py_ssize_t m, double t) noexcept
    @cython.locals(t=double)
    cdef Py_ssize_t _beside_capsule(self, Py_ssize_t row, Py_ssize_t k, Py_ssize_t m) noexcept
    @cython.locals(A="double[:, ::1]", B="double[:, ::1]", aa=double, ab=double, bb=double,
                   ar=double, br=double, apart=double, square=double)
    cdef double _nearest_to_line(self, Py_ssize_t k, Py_ssize_t m) noexcept
    @cython.locals(A="double[:, ::1]", B="double[:, ::1]", along=double, square=double)
    cdef double _foot(self, Py_ssize_t k, Py_ssize_t m, double u) noexcept
    @cython.locals(square=double, distance=double)
    cdef void _between(
        self, Py_ssize_t row, Py_ssize_t k, Py_ssize_t m, double t, double u
    ) noexcept
    cdef void _differentiate(self, Py_ssize_t row, Py_ssize_t k, Py_ssize_t m) noexcept
    @cython.locals(r0=double, r1=double, r2=double, v0=double, v1=double, v2=double, change=double)
    cdef void _add(self, Py_ssize_t row, Py_ssize_t i, double[::1] x, double sign) noexcept
