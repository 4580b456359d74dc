# Cython types of adaptation.py, which also runs uncompiled (decision 0037).

cimport cython

from common.elementary cimport smooth_sign
from estimator.contact_detector cimport ContactDetector
from estimator.doubt cimport Doubt
from estimator.interval cimport Interval
from estimator.learning cimport Learning
from estimator.levels cimport Levels
from estimator.link_velocity cimport Alignment
from estimator.motor_position cimport MotorPosition
from estimator.needed_level cimport NeededLevel
from estimator.residual cimport Residual
from estimator.torques cimport Torques

cdef double _SETS_OUT, _REST_VELOCITY, _STATED, _MOST
cdef long long _GRAZED, _FRICTION
cdef Py_ssize_t _THETA_DOT, _BETA, _MOTOR_FRICTION, _ENGAGED_LINK_FRICTION, _STICTION

cdef class Adaptation:
    cdef bint _learns
    cdef readonly Learning learning
    cdef readonly Doubt doubt
    cdef Alignment _alignment
    cdef Interval _interval
    cdef Torques _torques
    cdef MotorPosition _motor_position
    cdef Residual _residual
    cdef Levels _levels
    cdef ContactDetector _detector
    cdef public long long frozen
    cdef Py_ssize_t _n
    cdef readonly long long[::1] given_up

    @cython.locals(doubt=double, doubted=double)
    cpdef double unknown(self, Py_ssize_t i) noexcept
    @cython.locals(learned=double, most=double, stated=double)
    cpdef double contested(self, Py_ssize_t i) noexcept
    cpdef double unlearned(self, Py_ssize_t i) noexcept
    @cython.locals(slides=double, coulomb=double, load=double)
    cpdef double unknown_at(self, Py_ssize_t i, double speed, double transmitted) noexcept
    @cython.locals(own=double, share=double)
    cpdef double load_friction(self, Py_ssize_t i, double tau_M) noexcept
    @cython.locals(
        coulomb=double, viscous=double, some=double, speed=double, doubt=double, moving=bint
    )
    cpdef void learn(
        self, Py_ssize_t i, double dt, double theta_dot, double load, double level, bint acts
    ) noexcept
    @cython.locals(
        q=double, velocity=double, corrected=double, raw=double, agree=bint, believed=double,
        configured=double, unknown=double, above=double, lowered=double, stated=double,
        verdict="long long"
    )
    cpdef void compare(self, Py_ssize_t i, double dt) noexcept
    @cython.locals(doubt=double, crossing=double)
    cpdef void apply(self, Py_ssize_t i) noexcept
    cdef double _doubted(self, Py_ssize_t i) noexcept
    @cython.locals(share=double)
    cdef double _share(self, Py_ssize_t i) noexcept
