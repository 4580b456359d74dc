# Types of guide.py, for the compiler alone.

cimport cython

from daemon.motion.back_rows cimport BackRows
from daemon.motion.guide_spring cimport GuideSpring
from estimator.dynamics cimport Dynamics
from estimator.frame cimport Frame

cdef extern from "math.h":
    cpdef double sqrt(double x) noexcept

cdef Py_ssize_t _PASSES, _ACROSS, _EVERY, _HOLDING, _FREE, _DAMPED
cdef double _ARM_M, _DAMPS, _SPRING_M_S, _SPRING_RAD_S
cdef double _LAGS_RAD_S, _LEAST, _CREEPS, _NEARS_S, _FORESEEN_S, _NEAR

cdef class Guide:
    cdef Py_ssize_t _n
    cdef Dynamics _dynamics
    cdef Frame _frame
    cdef BackRows _rows
    cdef readonly GuideSpring spring
    cdef bint _turned, _redundant
    cdef readonly bint begun
    cdef long long[::1] _bound
    cdef double[::1] _moved, _sent, _presses, _free, _out
    cdef double[::1] _most, _q, _rest, _v, _spring
    cdef double[:, ::1] _G, _M, _along

    cpdef void forget(self) noexcept
    @cython.locals(known=double)
    cpdef void begin(self, const double[:] q) noexcept
    @cython.locals(known=double, rows=Py_ssize_t, more=Py_ssize_t, pivot=double, slowed=double, bounded=double,
                   gentle=double, whole=double)
    cpdef void step(
        self, const double[:] q, const double[:] moved, const double[:] sent,
        const double[:] before, const double[:] wanted, const double[:] share, const double[:] gain,
        const double[:, :] room, const double[:] residual, bint hand, double dt,
        double[::1] out
    ) noexcept
    cdef void _frame_alone(self, const double[:] gain) noexcept
    @cython.locals(share=double, fastest=double)
    cdef double _bounded(self) noexcept
    @cython.locals(along=double, square=double)
    cdef double _with_the_hand(self, const double[:] gain, double[::1] out) noexcept
    @cython.locals(square=double, most=double, way=double, share=double, gentle=double)
    cdef double _gentle(self) noexcept
    @cython.locals(f=Frame)
    cdef void _see(self) noexcept
    @cython.locals(rows=Py_ssize_t)
    cdef void _resist(self, const double[:] gain, double dt) noexcept
    @cython.locals(r=BackRows, rows=Py_ssize_t, damps=bint)
    cdef Py_ssize_t _choose(self, Py_ssize_t which) noexcept
    @cython.locals(r=BackRows, v=double, way=double, moves=double)
    cdef Py_ssize_t _limit(
        self, Py_ssize_t rows, const double[:, :] room, double[::1] out
    ) noexcept
    @cython.locals(falls=double, left=double)
    cdef double _slowed(self, double pivot, const double[:] gain, double[::1] out) noexcept
