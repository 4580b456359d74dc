# C types of motor_laws.py, read by the compiler only.

cdef class MotorLaws:
    cdef Py_ssize_t _n
    cdef readonly Py_ssize_t positions, impedances, filters
    cdef double[::1] _targets, _currents, _goal, _velocity, _torque, _kp, _kd, _highest
    cdef double[::1] _per_torque, _heads, _impeded, _share, _smooth

    cpdef void measure(self, Py_ssize_t joint, double share) noexcept
    cpdef void head(self, Py_ssize_t joint, double goal, double gain, double fastest) noexcept
    cpdef void set_impedance(
        self, Py_ssize_t joint, double position, double velocity, double kp, double kd,
        double torque
    ) noexcept
    cpdef void scale(self, Py_ssize_t joint, double per_torque, double highest) noexcept
    cpdef void release(self, Py_ssize_t joint) noexcept
    cpdef void steer(self, double[::1] q, double[::1] phi) noexcept
    cpdef void respond(self, double[::1] q, double[::1] phi, double[::1] theta_dot) noexcept
    cpdef void follow(self, double[::1] theta_dot) noexcept
