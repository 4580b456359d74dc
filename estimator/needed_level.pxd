# Cython types of needed_level.py, which also runs uncompiled (decision 0037).

cimport cython

cdef extern from "math.h":
    cpdef double sqrt(double x) noexcept

cdef double _OF_RMS, _RMS_S, _AT_FIRST_S, _OF_PEAK, _PEAK_S, _LASTS_S, _LOUD, _QUIET_S
cdef double _OF_CROSSING, _CROSSING_S, _CROSSING, _LEAST_CROSSING, _GROWS, _LEANS_S, _PASSES_S, _RESTS_S, _LARGEST, _OF_CARRIED, _OF_USUAL

cdef class NeededLevel:
    cdef double[::1] _least
    cdef readonly double[::1] squares_s, moved_s, carried_s, carried, reach, peak, crossing_peak, peak_seen, crossing_seen, passing, lean, quiet_s, loud_s

    @cython.locals(share=double, peak=double)
    cpdef double level(self, Py_ssize_t i) noexcept
    @cython.locals(least=double)
    cpdef double crossing_level(self, Py_ssize_t i) noexcept
    @cython.locals(shown=double)
    cpdef void carry(self, Py_ssize_t i, double beta, double configured) noexcept
    cpdef void reset(self, Py_ssize_t i) noexcept
    @cython.locals(size=double, needed=double, quiet=bint)
    cpdef void note(
        self, Py_ssize_t i, double corrected, double level, double configured, double unknown,
        double friction, double raised, bint relearns, bint moving, double dt
    ) noexcept
    @cython.locals(fade=double)
    cpdef void rest(self, Py_ssize_t i, double dt) noexcept
    @cython.locals(fade=double, size=double, alone=double, known=double, square=double, peak=double)
    cdef void _measure(
        self, Py_ssize_t i, double corrected, double configured, double unknown, double friction,
        bint relearns, double dt
    ) noexcept
    @cython.locals(most=double)
    cdef void _count(self, Py_ssize_t i, bint relearns) noexcept
