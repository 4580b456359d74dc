# Cython types of motor_position.py, which also runs uncompiled (decision 0037).

cimport cython

cdef double LINK_REST, _CLEAR, _CLEAR_AT_REST, _RESTS_S, _RESTS_WITHIN, _SKEW_S, _PULL
cdef long long _LEFT, _GAP, _RIGHT, _UNKNOWN

cdef class MotorPosition:
    cdef double[::1] _alpha, _coulomb, _viscous, _compliance
    cdef readonly double[::1] friction, friction_error
    cdef double _rotor_error, _current_error, _half_gap_error
    cdef double _margin, _hysteresis, _scale_error, _bias, _standstill
    cdef long long _hold_ticks
    cdef bint _measured
    cdef readonly double[::1] theta, sigma, q, slipped, slipped_most, rested_at, rested_s
    cdef readonly signed char[::1] side
    cdef readonly long long[::1] streak, gap

    cpdef void start(self, Py_ssize_t i, double q) noexcept
    @cython.locals(before=bint, engaged=bint, clear=bint, rubs=double, doubt=double)
    cpdef bint step(
        self, Py_ssize_t i, double dt, double q, double q_dot, double theta_dot, double resting,
        double tau_M, double advance, double rotor, double transmitted
    ) noexcept
    @cython.locals(follows=bint)
    cpdef bint contradicted(self, Py_ssize_t i, double theta_dot) noexcept
    cdef void _hold(self, Py_ssize_t i, double moved) noexcept
    cdef double _correct(self, Py_ssize_t i, double q, bint engaged, double bent) noexcept
