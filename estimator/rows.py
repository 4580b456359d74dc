# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Many ticks of the estimator in one call, for recordings, logs and benchmarks."""

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from estimator.estimate import Flag
from estimator.kernel import Kernel

_INVALID = int(Flag.INVALID)


def step_through(
    kernel: Kernel,
    samples: NDArray[np.float64],
    arrived: NDArray[np.int64],
    dt: Vector,
    resets: NDArray[np.int64],
    shown: NDArray[np.float64],
    residuals: NDArray[np.float64],
    side: NDArray[np.int8],
    wrench: NDArray[np.float64],
    words: NDArray[np.int64],
) -> None:
    """Step through N ticks: samples (N, 4, n), arrived (N, n) and dt (N,), with a reset after
    each tick whose `resets` (N,) is 1.

    Results go to rows 1 to N of shown (N + 1, 10, n), residuals (N + 1, variants, n), side (N + 1,
    n), wrench (N + 1, WIDTH) and words (N + 1, 2): flags and touched link. Row 0 holds the previous
    result; an INVALID tick repeats the row before.
    """
    for k in range(dt.shape[0]):
        for i in range(kernel.n):
            kernel.arrived[i] = arrived[k, i]
            for row in range(4):
                kernel.alignment.samples[row, i] = samples[k, row, i]
        flags = kernel.step(dt[k])
        words[k + 1, 0] = flags
        if flags & _INVALID:
            words[k + 1, 0], words[k + 1, 1] = _INVALID, words[k, 1]
            shown[k + 1], residuals[k + 1], side[k + 1] = shown[k], residuals[k], side[k]
            wrench[k + 1] = wrench[k]
        else:
            words[k + 1, 1] = kernel.touched_link
            shown[k + 1], residuals[k + 1] = kernel.shown, kernel.residual.corrected
            side[k + 1], wrench[k + 1] = kernel.motor_position.side, kernel.wrench.shown
        if resets[k]:
            for i in range(kernel.n):
                kernel.reset(i)
