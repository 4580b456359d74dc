# Types of kernel.py, for the compiler alone.

cimport cython

from estimator.contact_detector cimport ContactDetector
from estimator.doubt cimport Doubt
from estimator.dynamics cimport Dynamics
from common.elementary cimport decay, smooth_sign
from estimator.interval cimport Interval
from estimator.learning cimport Learning
from estimator.levels cimport Levels
from estimator.link_velocity cimport Alignment
from estimator.motor_position cimport MotorPosition
from estimator.residual cimport Residual
from estimator.stiction cimport Stiction, displacement
from estimator.wrench cimport Wrench

cdef long long _INVALID, _LATE, _RESTARTED, _STARTING, _BRIDGED, _RAISED, _SIDE_GAP, _SIDE_UNKNOWN
cdef long long _GRAZED, _FRICTION
cdef double _SETS_OUT, _STOP, _REST_VELOCITY
cdef double _LATE_PERIODS, _RAISED_PERIODS, _SENSED_PERIODS, _BRIDGED_PERIODS
cdef Py_ssize_t _SAMPLES, _MOMENTUM, _ROTOR, _THETA, _THETA_DOT, _BETA, _TAU_M, _MOTOR_FRICTION
cdef Py_ssize_t _ENGAGED_LINK_FRICTION, _LINK_FRICTION, _GAP_FRICTION, _STICTION

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
    cdef readonly Wrench wrench
    cdef readonly bint learns
    cdef bint _always_acts
    cdef double _period, _per_width
    cdef bint _measured
    cdef double[::1] _K_c, _B, _alpha, _coulomb, _motor_coulomb, _motor_viscous, _link_coulomb
    cdef double[::1] _link_viscous, _gap_coulomb, _gap_viscous, _K_phi_p, _K_phi_d, _load
    cdef readonly long long[::1] came, going
    cdef readonly unsigned char[::1] sensing
    cdef readonly double[::1] since, q, q_dot, tau_M, transmitted, threshold
    cdef double[::1] _gaps, _theta, _phi, _sigma, _thresholded, _share, _uncorrected
    cdef readonly long long begun, touched_link
    cdef long long _pressed, _landed
    cdef long long[::1] _crossing
    cdef readonly long long[::1] given_up
    cdef public double elapsed_s
    cdef readonly double[::1] payload, lower, upper
    cdef public long long frozen
    cdef readonly double[:, ::1] shown

    @cython.locals(valid=bint)
    cpdef long long step(self, double dt) noexcept
    @cython.locals(flags="long long")
    cpdef void run(
        self, const double[:, :, ::1] samples, const long long[:, ::1] came, const double[::1] dt,
        const long long[::1] resets, double[:, :, ::1] shown, double[:, :, ::1] residuals,
        signed char[:, ::1] side, double[:, ::1] wrench, long long[:, ::1] words
    ) noexcept
    @cython.locals(change=double)
    cpdef void carry(self, double[::1] payload) noexcept
    cpdef void put_on(self, double[::1] payload) noexcept
    cpdef void restart(self, Py_ssize_t i) noexcept
    cpdef void reset(self, Py_ssize_t i) noexcept
    @cython.locals(unknown=double)
    cpdef void resume(self) noexcept
    @cython.locals(above=double, viscous=double, coulomb=double)
    cpdef double level_at(self, Py_ssize_t i, double speed) noexcept
    @cython.locals(flags="long long", ready=bint, counted=bint)
    cdef long long _take(self) noexcept
    cdef void _still(self, Py_ssize_t i, double q) noexcept
    @cython.locals(flags="long long", bridged=bint, everything=double)
    cdef long long _advance(self, double dt) noexcept
    @cython.locals(moves=bint, free=bint, share=double, unlearned=double)
    cdef void _weigh(self, double dt) noexcept
    @cython.locals(side="long long", in_gap=bint, came_from=bint, everything=double)
    cdef double _joint(self, Py_ssize_t i, double gap) noexcept
    @cython.locals(
        came=bint, unknown=bint, crossing=bint, shaken=bint, unsure=double, begun="long long"
    )
    cdef double _judge(self, Py_ssize_t i, double gap, double dt, bint bridged) noexcept
    @cython.locals(
        q=double, velocity=double, corrected=double, raw=double, agree=bint, believed=double,
        usual=double, unknown=double, above=double, lowered=double, stated=double,
        verdict="long long"
    )
    cdef void _hold_against(self, Py_ssize_t i, double dt) noexcept
    cdef double _doubted(self, Py_ssize_t i) noexcept
    cdef double _lowered_share(self, Py_ssize_t i) noexcept
    @cython.locals(doubt=double, doubted=double)
    cdef double _unknown(self, Py_ssize_t i) noexcept
    @cython.locals(own=double, share=double)
    cdef double _load_friction(self, Py_ssize_t i) noexcept
    cdef void _put_in_force(
        self, Py_ssize_t i, double unsure, double speed, double dt
    ) noexcept
    cdef void _at_an_instant(
        self, Py_ssize_t i, double q_dot, double theta_dot, double theta, double tau_M,
        double turned
    ) noexcept
    @cython.locals(touched=bint, rubs=double, transmitted=double, slides=double, load=double)
    cdef void _balance(
        self, Py_ssize_t i, double dt, double q, double q_dot, double theta_dot, double rest,
        double tau_M
    ) noexcept
    @cython.locals(doubt=double, share=double, crossing=double)
    cdef void _apply(self, Py_ssize_t i) noexcept
    @cython.locals(
        coulomb=double, viscous=double, some=double, speed=double, usual=double, doubt=double,
        moving=bint
    )
    cdef void _learn(
        self, Py_ssize_t i, double dt, double theta_dot, double load, bint acts
    ) noexcept
    cdef void _show(self, Py_ssize_t i) noexcept
