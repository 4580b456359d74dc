# Types of measures.py, for the compiler alone.

cimport cython

cdef Py_ssize_t JUMP, OVERSPEED, TORQUE_STUCK, TORQUE_SATURATED
cdef Py_ssize_t RESIDUAL_LIMIT, JOINT_LIMIT, FROZEN, APART, ROWS

@cython.locals(good=bint)
cpdef bint within(const double[:] a, const double[:] b, const double[:] bound) noexcept

cdef class Measures:
    cdef readonly Py_ssize_t n
    cdef readonly double[:, ::1] bounds, measures
    cdef readonly double[::1] q, q_before, current, velocity, dt
    cdef readonly double[::1] full_ticks, fast_ticks, same_ticks
    cdef double[::1] _middle, _play, _full, _speed
    cdef double[::1] _theta, _lowest, _highest, _turned, _turned_stuck
    cdef double _standstill, _drift, _scale_error
    cdef unsigned char[::1] _begun

    cpdef void restart(self) noexcept
    @cython.locals(beyond=bint, same=bint, advance=double, everything=double)
    cpdef bint step(
        self, const double[:] q, const double[:] motor_velocity, const double[:] motor_position,
        const double[:] current, const double[:] residual, const double[:] dt, bint energised
    ) noexcept
    @cython.locals(advance=double)
    cdef double _integrated(self, Py_ssize_t i, double velocity, double dt) noexcept
    cdef void _start(self, Py_ssize_t i) noexcept
    cdef void _follow_gap(self, Py_ssize_t i, double advance, bint same) noexcept
    cdef void _follow_motion(
        self, Py_ssize_t i, double advance, bint same, double residual
    ) noexcept
