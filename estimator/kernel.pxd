# Cython types of kernel.py, which also runs uncompiled (decision 0037).

cimport cython

from estimator.adaptation cimport Adaptation
from estimator.arrivals cimport Arrivals
from estimator.contact_detector cimport ContactDetector
from estimator.doubt cimport Doubt
from estimator.dynamics cimport Dynamics
from common.elementary cimport decay
from estimator.interval cimport Interval
from estimator.learning cimport Learning
from estimator.levels cimport Levels
from estimator.link_velocity cimport Alignment
from estimator.motor_position cimport MotorPosition
from estimator.residual cimport Residual
from estimator.stiction cimport Stiction, displacement
from estimator.torques cimport Torques
from estimator.wrench cimport Wrench

cdef long long _INVALID, _RESTARTED, _STARTING, _SIDE_GAP, _SIDE_UNKNOWN
cdef double _STOP, _REST_VELOCITY
cdef Py_ssize_t _SAMPLES, _ROTOR, _THETA, _THETA_DOT, _TAU_M, _MOTOR_FRICTION

cdef class Kernel:
    cdef readonly Py_ssize_t n
    cdef Dynamics _dynamics
    cdef readonly Alignment alignment
    cdef readonly Interval interval
    cdef readonly MotorPosition motor_position
    cdef readonly Stiction stiction
    cdef readonly Residual residual
    cdef readonly Levels levels
    cdef readonly ContactDetector detector
    cdef readonly Learning learning
    cdef readonly Doubt doubt
    cdef readonly Adaptation adaptation
    cdef readonly Torques torques
    cdef readonly Arrivals arrivals
    cdef readonly Wrench wrench
    cdef readonly bint learns
    cdef bint _always_acts
    cdef double _period
    cdef bint _measured
    cdef readonly long long[::1] arrived, going
    cdef readonly unsigned char[::1] sensing
    cdef readonly double[::1] since, q, q_dot, tau_M, transmitted, threshold
    cdef double[::1] _theta, _phi, _sigma, _thresholded, _share, _uncorrected
    cdef readonly long long begun, touched_link
    cdef long long _pressed, _landed
    cdef long long[::1] _crossing
    cdef public double elapsed_s
    cdef readonly double[::1] lower, upper
    cdef readonly double[:, ::1] shown

    @cython.locals(valid=bint)
    cpdef long long step(self, double dt) noexcept
    cpdef void restart(self, Py_ssize_t i) noexcept
    cpdef void reset(self, Py_ssize_t i) noexcept
    @cython.locals(speed=double)
    cpdef void resume(self) noexcept
    @cython.locals(flags="long long", flag="long long")
    cdef long long _take(self) noexcept
    cdef void _still(self, Py_ssize_t i, double q) noexcept
    @cython.locals(flags="long long", bridged=bint, everything=double)
    cdef long long _advance(self, double dt) noexcept
    @cython.locals(moves=bint, free=bint, share=double, unlearned=double)
    cdef void _weigh(self, double dt) noexcept
    @cython.locals(side="long long", in_gap=bint, came_from=bint, everything=double)
    cdef double _joint(self, Py_ssize_t i, double gap) noexcept
    @cython.locals(
        arrived=bint, unknown=bint, crossing=bint, shaken=bint, uncertainty=double, begun="long long"
    )
    cdef double _judge(self, Py_ssize_t i, double gap, double dt, bint bridged) noexcept
    @cython.locals(unknown=double)
    cdef void _put_in_force(
        self, Py_ssize_t i, double uncertainty, double speed, double dt
    ) noexcept
    @cython.locals(
        touched=bint, rubs=double, transmitted=double, load=double, spring=double, acts=bint
    )
    cdef void _balance(
        self, Py_ssize_t i, double dt, double q, double q_dot, double theta_dot, double rest,
        double tau_M
    ) noexcept
    cdef void _show(self, Py_ssize_t i) noexcept
