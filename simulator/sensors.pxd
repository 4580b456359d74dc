# C types of sensors.py, read by the compiler only.

from common.elementary cimport sine


cdef class Sensors:
    cdef Py_ssize_t _n, _rows, _oldest
    cdef object _rng
    cdef bint _late
    cdef double _velocity_scale, _velocity_bias, _velocity_noise, _current_noise, _late_share
    cdef double[::1] _link_per_rad, _link_zero, _motor_per_turn, _velocity_unit, _velocity_step
    cdef double[::1] _gear, _per_ampere, _gain, _current, _at_motor
    cdef double[:, ::1] _history
    cdef double[:, :, ::1] _link_errors, _motor_errors

    cpdef void update(self, double[::1] q, double[::1] current) noexcept
    cdef object _counts(
        self, double[::1] q, double[::1] theta, double[::1] theta_dot, double[:, ::1] noise
    )

cdef double repeated(double[:, :, ::1] errors, Py_ssize_t joint, double angle) noexcept
cdef long long whole(double x) noexcept
