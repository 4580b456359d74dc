# Cython types of play.py, which also runs uncompiled (decision 0037).

cimport cython

@cython.locals(most=double, about=double)
cpdef void put_play(
    const double[:] half_gap, const double[:] phi, const double[:] sigma, double[:, ::1] way
) noexcept
