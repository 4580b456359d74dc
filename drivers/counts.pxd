# C types of counts.py, read by the compiler only.

cimport cython

from common.elementary cimport cosine, sine

cdef double _ROUNDING, _LARGEST

cpdef decode(
    list raw, const long long[:, ::1] order, const double[:, ::1] gain, const double[:, ::1] bias,
    double[:, ::1] values
)
@cython.locals(angle=double, error=double, turned=double, i=Py_ssize_t, k=Py_ssize_t)
cpdef void correct(
    double[:] position, const double[::1] offset, const double[:, :, ::1] harmonics
) noexcept
@cython.locals(finite=bint, wanted=double)
cpdef bint encode(
    const double[:] velocity, const double[::1] gain, const double[::1] bias,
    const double[::1] lowest, const double[::1] highest, double[::1] counts
) noexcept
