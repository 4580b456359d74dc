# Types of counts.py, for the compiler alone.

cimport cython

cdef double _ROUNDING, _LARGEST

cpdef decode(
    list raw, const long long[:, ::1] order, const double[:, ::1] gain, const double[:, ::1] bias,
    double[:, ::1] values
)
@cython.locals(finite=bint, wanted=double)
cpdef bint encode(
    const double[:] velocity, const double[::1] gain, const double[::1] bias,
    const double[::1] lowest, const double[::1] highest, double[::1] counts
) noexcept
