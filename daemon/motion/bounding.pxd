# Types of bounding.py, for the compiler alone.

cimport cython

cdef double LARGEST

cdef class Bounding:
    cdef readonly Py_ssize_t n
    cdef double[::1] _lower, _upper, _velocity, _acceleration
    cdef double _reaction_s

    @cython.locals(known=double)
    cpdef void bound_velocity(
        self, const double[:] q, const double[:] desired, const double[:] before, double dt,
        const double[:, :] play, double[::1] out
    ) noexcept
    @cython.locals(down=double, up=double, room=double)
    cpdef void soft_stop(
        self, const double[:] q, const double[:] desired, double gain, const double[:, :] play,
        double[::1] out
    ) noexcept
    cdef double _funnel(self, Py_ssize_t i, double distance) noexcept
