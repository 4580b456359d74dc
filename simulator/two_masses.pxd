# C types of two_masses.py, read by the compiler only.

from common.elementary cimport decay, smooth_sign
from simulator.gears cimport Gears
from simulator.links cimport Links

cdef class TwoMasses:
    cdef readonly Py_ssize_t n
    cdef readonly Links links
    cdef readonly Gears gears
    cdef double _step, _per_slip, _breakaway, _per_stribeck
    cdef bint _stiction
    cdef readonly double[::1] phi, q, q_dot, theta_dot, external, motor, free, gear, stop, half_gap
    cdef readonly double[:, ::1] friction, coulomb, viscous, deflection
    cdef double[::1] _link, _mean_half_gap, _lower, _upper, _stiffness, _damping, _rotor
    cdef double[:, ::1] _bristle_damping

    cpdef int advance(self, Py_ssize_t steps, object touch) except -1
    cdef void _push(self, Py_ssize_t i) noexcept
    cdef double _border(self, Py_ssize_t i, double delta, double delta_dot) noexcept
    cdef double _rub(self, Py_ssize_t side, Py_ssize_t i, double velocity, double load) noexcept
    cdef double _slide(
        self, Py_ssize_t side, Py_ssize_t i, double way, double coulomb, double share
    ) noexcept
    cdef void _move(self, Py_ssize_t i) noexcept
