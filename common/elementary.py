# cython: language_level=3, infer_types=True, annotation_typing=False, cdivision=True
"""Elementary functions made of sums and products only: bit-identical on every processor.

The last bit of a C library's results differs between its versions, and between processors with and
without fused multiply-add. Errors here stay below 5e-16, relative or absolute. Non-finite
arguments, and angles beyond a million radians, yield a non-finite result; nothing is raised.
"""


def sine(x: float) -> float:
    """sin(x), |x| < 1e6 rad."""
    return _turned(x, 0.0)


def cosine(x: float) -> float:
    """cos(x), |x| < 1e6 rad."""
    return _turned(x, 1.0)


def _turned(x: float, quadrants: float) -> float:
    """Sine of x plus `quadrants` right angles, by a Taylor series within 45 degrees of an axis."""
    if not -1e6 < x < 1e6:
        return x * 1e300 * 1e300 * 0.0  # NaN
    # Adding and subtracting 1.5 * 2^52 rounds to a whole number.
    k = (x * 0.6366197723675814 + 6755399441055744.0) - 6755399441055744.0
    # pi / 2 in three parts, the first two short enough that their products with k are exact.
    r = ((x - k * 1.570796325802803) - k * 9.920935791635221e-10) - k * 5.170182981794105e-19
    k += quadrants
    k -= 4.0 * ((k * 0.25 - 0.375 + 6755399441055744.0) - 6755399441055744.0)  # 0, 1, 2 or 3
    z = r * r
    if k * (k - 2.0) == 0.0:
        y = 1.0 / 6227020800.0 - z * (1.0 / 1307674368000.0 - z / 355687428096000.0)
        y = 1.0 / 120.0 - z * (1.0 / 5040.0 - z * (1.0 / 362880.0 - z * (1.0 / 39916800.0 - z * y)))
        y = r - r * z * (1.0 / 6.0 - z * y)
    else:
        y = 1.0 / 479001600.0 - z * (1.0 / 87178291200.0 - z / 20922789888000.0)
        y = 1.0 / 24.0 - z * (1.0 / 720.0 - z * (1.0 / 40320.0 - z * (1.0 / 3628800.0 - z * y)))
        y = 1.0 - (0.5 * z - z * z * y)
    return -y if k >= 2.0 else y


def decay(x: float) -> float:
    """exp(-x) for x >= 0; 0 from x = 700 on."""
    if x >= 700.0:
        return 0.0
    k = (x * 1.4426950408889634 + 6755399441055744.0) - 6755399441055744.0
    r = -((x - k * 0.6931471805592082) - k * 7.371002565167799e-13)
    y = 1.0 / 3628800.0 + r * (1.0 / 39916800.0 + r * (1.0 / 479001600.0 + r / 6227020800.0))
    y = 1.0 / 720.0 + r * (1.0 / 5040.0 + r * (1.0 / 40320.0 + r * (1.0 / 362880.0 + r * y)))
    y = 0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * y)))
    y = 1.0 + (r + r * r * y)
    while k >= 64.0:
        y *= 5.421010862427522e-20  # 2^-64
        k -= 64.0
    while k >= 8.0:
        y *= 0.00390625
        k -= 8.0
    while k >= 1.0:
        y *= 0.5
        k -= 1.0
    return y


def smooth_sign(x: float) -> float:
    """tanh(x): a sign function without chatter at rest."""
    e = decay(2.0 * abs(x))
    y = (1.0 - e) / (1.0 + e)
    return y if x >= 0.0 else -y
