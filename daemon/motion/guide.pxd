# Types of guide.py, for the compiler alone.

cimport cython

from daemon.motion.constraint_rows cimport ConstraintRows
from daemon.motion.guide_spring cimport GuideSpring
from estimator.dynamics cimport Dynamics
from estimator.frame cimport Frame

cdef extern from "math.h":
    cpdef double sqrt(double x) noexcept

cdef Py_ssize_t _PASSES, _NOT_FREE, _ALL, _HELD_ROWS, _FREE, _DAMPED
cdef double _ARM_M, _DAMPING, _SPRING_M_S, _SPRING_RAD_S
cdef double _DRIVE_LAG_RAD_S, _LEAST_PIVOT, _LEAST_LEFT, _APPROACH_S, _LOOKAHEAD_S, _TOLERANCE

cdef class Guide:
    cdef Py_ssize_t _n
    cdef Dynamics _dynamics
    cdef Frame _frame
    cdef ConstraintRows _rows
    cdef readonly GuideSpring spring
    cdef bint _turned, _redundant
    cdef readonly bint started
    cdef long long[::1] _bound
    cdef double[::1] _motor_velocity, _setpoint, _press, _unguided, _out
    cdef double[::1] _max_velocity, _q, _rest, _v, _spring
    cdef double[:, ::1] _G, _M, _along

    cpdef void forget(self) noexcept
    @cython.locals(known=double)
    cpdef void begin(self, const double[:] q) noexcept
    @cython.locals(known=double, rows=Py_ssize_t, more=Py_ssize_t, pivot=double, led_share=double, speed_share=double,
                   spring_share=double, whole=double)
    cpdef void step(
        self, const double[:] q, const double[:] moved, const double[:] sent,
        const double[:] before, const double[:] wanted, const double[:] share, const double[:] gain,
        const double[:, :] room, const double[:] residual, bint hand, double dt,
        double[::1] out
    ) noexcept
    cdef void _remove_null_space(self, const double[:] gain) noexcept
    @cython.locals(share=double, fastest=double)
    cdef double _speed_share(self) noexcept
    @cython.locals(along=double, square=double)
    cdef double _passive_share(self, const double[:] gain, double[::1] out) noexcept
    @cython.locals(square=double, most=double, way=double, share=double, spring_share=double)
    cdef double _spring_share(self) noexcept
    @cython.locals(f=Frame)
    cdef void _update_rows(self) noexcept
    @cython.locals(rows=Py_ssize_t)
    cdef void _fade_spring(self, const double[:] gain, double dt) noexcept
    @cython.locals(r=ConstraintRows, rows=Py_ssize_t, damps=bint)
    cdef Py_ssize_t _select_rows(self, Py_ssize_t which) noexcept
    @cython.locals(r=ConstraintRows, v=double, way=double, moves=double)
    cdef Py_ssize_t _add_joint_limits(
        self, Py_ssize_t rows, const double[:, :] room, double[::1] out
    ) noexcept
    @cython.locals(falls=double, left=double)
    cdef double _singularity_share(self, double pivot, const double[:] gain, double[::1] out) noexcept
