# Types of stiction.py, for the compiler alone.

cdef double CREEP, LINK_REST

cpdef double displacement(
    double theta_dot, double q_dot, double moved, bint has_gap, double dt
) noexcept

cdef class Stiction:
    cdef double _per_presliding
    cdef readonly double[:, ::1] ends

    cpdef void restart(self, Py_ssize_t i) noexcept
    cpdef void step(self, Py_ssize_t i, double displacement) noexcept
    cpdef double z(self, Py_ssize_t i) noexcept
    cpdef double unknown(self, Py_ssize_t i) noexcept
