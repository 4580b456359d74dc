# Cython types of rows.py, which also runs uncompiled (decision 0037).

cimport cython

from estimator.kernel cimport Kernel
from estimator.link_velocity cimport Alignment
from estimator.motor_position cimport MotorPosition
from estimator.residual cimport Residual
from estimator.wrench cimport Wrench

cdef long long _INVALID

@cython.locals(flags="long long", k=Py_ssize_t, i=Py_ssize_t, row=Py_ssize_t)
cpdef void step_through(
    Kernel kernel, const double[:, :, ::1] samples, const long long[:, ::1] arrived,
    const double[::1] dt, const long long[::1] resets, double[:, :, ::1] shown,
    double[:, :, ::1] residuals, signed char[:, ::1] side, double[:, ::1] wrench,
    long long[:, ::1] words
) noexcept
