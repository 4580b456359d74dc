# Cython types of frame.py, which also runs uncompiled (decision 0037).

cimport cython

from estimator.dynamics cimport Dynamics

cdef class Frame:
    cdef Dynamics _dynamics
    cdef Py_ssize_t _body
    cdef double[::1] _place, _swap
    cdef double[:, ::1] _axes, _swaps
    cdef readonly double[::1] x
    cdef readonly double[:, ::1] J, R

    @cython.locals(d=Dynamics, i=Py_ssize_t, row=Py_ssize_t)
    cpdef void at(self) noexcept
