# C types of servo.py, read by the compiler only.

cdef class Servo:
    cdef Py_ssize_t _n
    cdef readonly object damping, stiffness, target, reference, rate, current
    cdef double[::1] _targets, _references, _rates, _currents
    cdef double[::1] _kp, _ki_step, _highest, _wanted, _integral, _energised, _per_rise

    cpdef void energise(self, Py_ssize_t joint, double velocity) noexcept
    cpdef void release(self, Py_ssize_t joint) noexcept
    cpdef void limit(self, Py_ssize_t joint, double current) noexcept
    cpdef void tune(self, Py_ssize_t joint, double kp, double ki) noexcept
    cpdef bint energised(self, Py_ssize_t joint) noexcept
    cpdef void follow(self, Py_ssize_t joint, double velocity, double over_s) noexcept
    cpdef void ramp(self, Py_ssize_t joint, double velocity, double acceleration) noexcept
    cpdef void slew(self, Py_ssize_t joint, double velocity, double rise, double fall) noexcept
    cpdef bint arrived(self, Py_ssize_t joint) noexcept
    cpdef bint saturated(self, Py_ssize_t joint) noexcept
    cpdef void update(self, double[::1] velocity) noexcept
