# Cython types of wrench.py, which also runs uncompiled (decision 0037).

cimport cython

from estimator.frame cimport Frame

cdef extern from "math.h":
    cpdef double sqrt(double x) noexcept

cdef Py_ssize_t _COVARIANCE, _STRENGTH, _MISFIT, _UNSEEN, _SWEEPS
cdef double _SEEN_N, _SEEN_SHARE, _SEEN_MOST_N, _LEVEL, _FRICTION, _RAISED, _UNLEARNED, _TORQUE
cdef double _LAG, _LEAST_NM, _HIDDEN, _STUCK, _OF_LEVEL
cdef double _OFF, _USUAL_N, _ANY_N, _LEAST, _MOST, _OF_PEAK, _GROWS, _FADES_S, _QUIET_S, _PEAK_S

cdef class Wrench:
    cdef Frame _frame
    cdef double _gain, _level
    cdef double[::1] _r, _g, _h, _u
    cdef double[:, ::1] _Y, _N, _S, _V
    cdef readonly double[::1] before, lag, shown, weight
    cdef public double peak, peak_seen, quiet_s

    @cython.locals(lag=double, parts=double)
    cpdef void weigh(
        self, Py_ssize_t i, double r, double dt, double configured, double friction, double raised,
        double unlearned, double torque, bint senses
    ) noexcept
    @cython.locals(square=double, misfit=double, strength=double, counted=double, along=double, level=double)
    cpdef void step(self, double dt, bint pressed, bint teaches) noexcept
    cpdef double level(self) noexcept
    @cython.locals(square=double)
    cpdef void nothing(self) noexcept
    cdef void _learn(self, double strength, bint touched, double dt) noexcept
    @cython.locals(J="double[:, ::1]", rr=double, w=double, wJ=double)
    cdef double _inform(self) noexcept
    @cython.locals(beforehand=double, explained=double, through=double)
    cdef double _solve(self, double square, double any_N) noexcept
    @cython.locals(square=double, hidden=double, along=double)
    cdef double _size(self) noexcept
    cdef void _invert(self) noexcept
    @cython.locals(off=double)
    cdef void _directions(self) noexcept
    @cython.locals(o=Py_ssize_t, theta=double, t=double, c=double, s=double)
    cdef void _rotate(self, Py_ssize_t p, Py_ssize_t q) noexcept
    @cython.locals(square=double, most=double, variance=double, seen=bint, column=Py_ssize_t, slot=Py_ssize_t)
    cdef void _show(self, bint acts) noexcept
