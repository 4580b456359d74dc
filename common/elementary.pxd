# Cython types of elementary.py, which also runs uncompiled (decision 0037).

cpdef double sine(double x) noexcept
cpdef double cosine(double x) noexcept
cdef double _turned(double x, double quadrants) noexcept
cpdef double decay(double x) noexcept
cpdef double smooth_sign(double x) noexcept
