# C types of gears.py, read by the compiler only.

from common.elementary cimport sine, smooth_sign


cdef class Gears:
    cdef readonly bint active
    cdef double[::1] _motor_phase, _link_phase, _cog_phase, _gap_phase, _gear, _cogging
    cdef double _mean_share, _half_difference, _ripple, _gap_ripple, _rise, _sets, _runs_in
    cdef readonly double[::1] rested
    cdef readonly double[:, ::1] factor

    cpdef void update(self, Py_ssize_t i, double q, double theta, double theta_dot) noexcept
    cpdef double coulomb(self, double gear_torque, double theta_dot) noexcept
    cpdef double cog(self, Py_ssize_t i, double theta) noexcept
    cpdef double half_gap(self, Py_ssize_t i, double half_gap, double q) noexcept
