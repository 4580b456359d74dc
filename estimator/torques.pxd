# Cython types of torques.py, which also runs uncompiled (decision 0037).

cimport cython

from common.elementary cimport smooth_sign
from estimator.dynamics cimport Dynamics
from estimator.interval cimport Interval
from estimator.stiction cimport Stiction

cdef Py_ssize_t _MOMENTUM, _ROTOR, _THETA, _THETA_DOT, _BETA, _TAU_M, _MOTOR_FRICTION
cdef Py_ssize_t _ENGAGED_LINK_FRICTION, _LINK_FRICTION, _GAP_FRICTION, _STICTION

cdef class Torques:
    cdef Dynamics _dynamics
    cdef Stiction _stiction
    cdef Interval _interval
    cdef readonly double per_width
    cdef readonly double[::1] K_c, alpha, coulomb, viscous, load, payload
    cdef double[::1] _B, _motor_coulomb, _motor_viscous, _link_coulomb, _link_viscous
    cdef double[::1] _gap_coulomb, _gap_viscous, _K_phi_p, _K_phi_d

    cpdef void at(
        self, Py_ssize_t i, double q_dot, double theta_dot, double theta, double tau_M, double turned
    ) noexcept
    @cython.locals(delta=double)
    cpdef double spring(self, Py_ssize_t i, double phi, double phi_dot) noexcept
    cpdef double slides(self, Py_ssize_t i, double theta_dot) noexcept
    @cython.locals(change=double)
    cpdef void carry(self, double[::1] payload, double[:, ::1] aligned, long long[::1] going) noexcept
    @cython.locals(last=Py_ssize_t)
    cpdef void put_on(self, double[::1] payload) noexcept
    cdef void _count_momentum(
        self, double[:, ::1] aligned, long long[::1] going, double sign
    ) noexcept
