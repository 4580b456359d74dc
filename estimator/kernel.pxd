# Types of kernel.py, for the compiler alone.

cimport cython

from estimator.dynamics cimport Dynamics
from estimator.elementary cimport decay, smooth_sign
from estimator.gap cimport Gap

cdef long long INVALID, LATE, RESTARTED, STARTING, BRIDGED, RAISED, SIDE_UNKNOWN, WAITS
cdef double CREEP, LINK_REST, REST_VELOCITY, SHORTEST_S, SENSED_PERIODS, BRIDGED_PERIODS, RAISED_PERIODS
cdef double MISSING_SHARE, MISSING_MOST
cdef Py_ssize_t SAMPLES, MOMENTUM, ROTOR, THETA, THETA_DOT, BETA, TAU_M, MOTOR_FRICTION
cdef Py_ssize_t ENGAGED_LINK_FRICTION, LINK_FRICTION, GAP_FRICTION, STICTION, TERMS

cdef class Kernel:
    cdef readonly Py_ssize_t n
    cdef Dynamics _dynamics
    cdef readonly Gap rotors
    cdef double _period, _gain, _back, _current_age, _velocity_age, _position_age
    cdef double _per_width, _per_presliding
    cdef long long _debounce
    cdef bint _measured
    cdef Py_ssize_t _variants
    cdef double[::1] _K_c, _B, _alpha, _motor_coulomb, _motor_viscous, _link_coulomb
    cdef double[::1] _link_viscous, _gap_coulomb, _gap_viscous, _held, _K_phi_p, _K_phi_d
    cdef double[::1] _contact, _collision, _per_speed, _raise_at_rest, _raise_unsure, _corrected
    cdef double[:, ::1] _always, _engaged
    cdef double[::1] _theta, _phi, _sigma, _thresholded
    cdef readonly double[:, ::1] shown, samples, aligned, ends, stiction, residual
    cdef readonly double[:, :, ::1] history
    cdef readonly double[::1] since, interval, interval_before, raised, above
    cdef readonly double[::1] q, q_dot, tau_M, threshold
    cdef double[::1] _gaps, _now, _impulse
    cdef readonly long long[::1] came, count, going, sensing
    cdef readonly long long[:, ::1] streak, waited, begins

    cpdef long long step(self, double dt) noexcept
    @cython.locals(ready=bint, counted=bint)
    cdef long long _take(self) noexcept
    cpdef void restart(self, Py_ssize_t i) noexcept
    cpdef void reset(self, Py_ssize_t i) noexcept
    cpdef void still(self, Py_ssize_t i, double q) noexcept
    cpdef void resume(self) noexcept
    cdef void _show(self, Py_ssize_t i) noexcept
    cdef void _push(self, Py_ssize_t i, double dt) noexcept
    cdef void _align(self, Py_ssize_t i, double dt) noexcept
    cdef double _earlier(self, Py_ssize_t i, Py_ssize_t row, double share) noexcept
    @cython.locals(going=bint, beside=bint)
    cdef long long _advance(self, double dt) noexcept
    @cython.locals(everything=double)
    cdef double _joint(self, Py_ssize_t i, double gap, double dt, bint beside) noexcept
    cdef double _presliding(self, Py_ssize_t i, double gap, double moved) noexcept
    @cython.locals(e=double, engaged=double)
    cdef void _balance(
        self, Py_ssize_t i, double dt, double q, double q_dot, double theta_dot, double rest,
        double tau_M
    ) noexcept
    cdef void _raise(self, Py_ssize_t i, double hidden, double speed, double dt) noexcept
    @cython.locals(begins=bint, past="long long", streak="long long")
    cdef void _detect(self, Py_ssize_t i, bint beside) noexcept
