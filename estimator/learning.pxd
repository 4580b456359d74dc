# Cython types of learning.py, which also runs uncompiled (decision 0037).

cimport cython

from estimator.needed_level cimport NeededLevel

cdef extern from "math.h":
    cpdef double sqrt(double x) noexcept

cdef Py_ssize_t _CONSTANT, _VISCOUS, _COULOMB, _LOAD, _COLUMNS
cdef double _STANDS_S, _RESTING, _DOUBTED, _RELEARNS, _SETTLES_S
cdef double _NOISE, _NOISE_S, _OFF, _LOAD_OFF, _REMAINS, _FREEZES, _THAWS, _FROZEN_S

cdef class Learning:
    cdef double[:, ::1] _variance, _lowest, _highest
    cdef double[::1] _noise, _forgets_s, _x, _load_may_be, _load_error
    cdef readonly NeededLevel needed
    cdef readonly double[:, :, ::1] covariance
    cdef readonly double[:, ::1] columns, shares
    cdef readonly double[::1] coulomb_left, viscous_left, calm_s, still_s, settled, correction, unknown

    cpdef void reset(self, Py_ssize_t i) noexcept
    cpdef double friction(self, Py_ssize_t i) noexcept
    cpdef double load(self, Py_ssize_t i) noexcept
    cpdef double error(self, Py_ssize_t i) noexcept
    @cython.locals(learned=double, of_load=double, own=double)
    cpdef double unknown_at(
        self, Py_ssize_t i, double coulomb, double viscous, double load
    ) noexcept
    @cython.locals(load=double)
    cpdef double doubted_at(self, Py_ssize_t i, double doubt) noexcept
    cpdef bint stood(self, Py_ssize_t i) noexcept
    cpdef double identified(self, Py_ssize_t i) noexcept
    cpdef void reset_uncertainty(self, Py_ssize_t i) noexcept
    cpdef void give_up(self, Py_ssize_t i) noexcept
    @cython.locals(constant=double)
    cpdef void step(
        self, Py_ssize_t i, double coulomb, double viscous, double load, double dt, double pole, double share
    ) noexcept
    @cython.locals(
        corrected=double, size=double, b=double, surprise=double, freezes=double, calm=bint, known=bint
    )
    cpdef void learn(
        self, Py_ssize_t i, double residual, double level, double configured, double friction, double raised,
        double doubt, bint rubs, bint moving, bint suspended, double dt
    ) noexcept
    cdef void _rest(self, Py_ssize_t i, double dt) noexcept
    @cython.locals(moved=double)
    cdef bint _relearns(self, Py_ssize_t i, double configured) noexcept
    cdef void _say_what_is_left(self, Py_ssize_t i) noexcept
    @cython.locals(fade=double)
    cdef void _drift(self, Py_ssize_t i, Py_ssize_t column, double dt) noexcept
    @cython.locals(variance=double, error=double, gain_k=double, gain_m=double)
    cdef void _follow(self, Py_ssize_t i, double residual, double doubt, double dt, bint known) noexcept
    @cython.locals(left=double)
    cdef double _left(self, Py_ssize_t i, Py_ssize_t column) noexcept
    cdef void _forget(self, Py_ssize_t i) noexcept
