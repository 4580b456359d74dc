# Cython types of doubt.py, which also runs uncompiled (decision 0037).

cimport cython

cdef long long _AGREES, _ENDED, _GRAZED, _FRICTION
cdef double _APART_S, _HOLDS_S, _FADES_S, _LASTS_S, _RISES_S, _WIDTH, _CLEARS_S, _FLIPS_S
cdef double _CREEPS_S, _NEAR_S, _NEAR, _GRAZES, _MARGIN, _MOST_MARGIN, _MARGIN_S, _NEEDED_S, _NEEDED, _SOME

cdef class Doubt:
    cdef readonly double[::1] value, lasted_s, upwards_owed_s, downwards_owed_s, low, high, cleared_s, upwards_s, downwards_s, away_s, near_s, depth, margin, needed_s
    cdef readonly long long[::1] way, beyond, rubs, placed, moving, met, interrupted

    cpdef double at(self, Py_ssize_t i, double q) noexcept
    @cython.locals(depth=double, grazed=bint)
    cpdef long long step(
        self, Py_ssize_t i, bint touched, double q, double velocity, double residual,
        double believed, double lowered, double stated, double dt
    ) noexcept
    @cython.locals(near=bint)
    cpdef void raise_at(self, Py_ssize_t i, double q) noexcept
    cpdef void raise_all(self, Py_ssize_t i) noexcept
    cpdef void widen(self, Py_ssize_t i, bint own) noexcept
    cpdef void reset(self, Py_ssize_t i) noexcept
    cdef void _owe(self, Py_ssize_t i, long long way) noexcept
    cdef long long _last(
        self, Py_ssize_t i, double velocity, double believed, double stated, double dt
    ) noexcept
    @cython.locals(here=bint, agrees=bint, signed="double")
    cdef long long _compare(
        self, Py_ssize_t i, double q, double velocity, double residual, double lowered, double dt
    ) noexcept
    cdef void _agree(self, Py_ssize_t i, double velocity, double dt) noexcept
    cdef long long _rub(self, Py_ssize_t i) noexcept
    cdef void _pass(self, Py_ssize_t i, double q, bint agrees, double dt) noexcept
