# Types of play.py, for the compiler alone.

cimport cython

@cython.locals(most=double, about=double)
cpdef void put_play(
    const double[:] half_gap, const double[:] phi, const double[:] sigma, double[:, ::1] way
) noexcept
