# Types of contact_detector.py, for the compiler alone.

cimport cython

from elementary cimport decay

cdef double _MISSING_SHARE, _MISSING_MOST, _CLEAR, _ABSENT
cdef long long _WAITS

cdef class ContactDetector:
    cdef Py_ssize_t _n
    cdef object _joints
    cdef double _gain
    cdef long long _debounce
    cdef double[:, ::1] _levels
    cdef double[::1] _per_speed, _at_rest, _held, _unsure
    cdef readonly double[::1] raised, above
    cdef readonly long long[:, ::1] streak, waited, begins

    cpdef double hidden(
        self, Py_ssize_t i, double rest, double unknown, bint unsure, double periods
    ) noexcept
    cpdef double level_at(self, Py_ssize_t i, double hidden, double speed) noexcept
    cpdef double put_in_force(self, Py_ssize_t i, double hidden, double speed, double dt) noexcept
    @cython.locals(
        begun="long long", past="long long", streak="long long", begins=bint
    )
    cpdef long long step(self, Py_ssize_t i, double residual, bint came, bint waits) noexcept
    cpdef Py_ssize_t touched_link(self, double[::1] residual) noexcept
    cpdef void reset(self, Py_ssize_t i) noexcept
