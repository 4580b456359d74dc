# Cython types of link_velocity.py, which also runs uncompiled (decision 0037).

cdef Py_ssize_t _SAMPLES, _CURRENT, _MOTOR_VELOCITY, _MOTOR_POSITION, _LINK_POSITION, _INPUTS
cdef Py_ssize_t _Q, _Q_DOT, _ALIGNED_CURRENT, _THETA_DOT, _THETA, _ALIGNED

cdef class Alignment:
    cdef readonly double delay_s
    cdef bint _by_motor
    cdef double _back, _current_age, _velocity_age, _position_age, _period
    cdef readonly double[:, ::1] samples, aligned
    cdef readonly double[:, :, ::1] history
    cdef readonly long long[::1] count
    cdef readonly double[::1] interval, interval_before

    cpdef void push(self, Py_ssize_t i, double dt) noexcept
    cdef void _begin(self, Py_ssize_t i) noexcept
    cpdef void align(self, Py_ssize_t i) noexcept
    cdef double _earlier(self, Py_ssize_t i, Py_ssize_t row, double share) noexcept
    cpdef void carry(self, Py_ssize_t i, double dt) noexcept
    cpdef void restart(self, Py_ssize_t i) noexcept
