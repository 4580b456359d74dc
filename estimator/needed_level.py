# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Contact level that each joint needs: a share of the configured one, from residuals in motion.

    share = reach max(2.9 rms, 1.6 peak, least), at most 1

rms and peak are of the corrected residual over the configured level, in the last minutes of motion.
reach is 1, and more in a pose in which the joint carries more than past motion has shown. Crossings
of the gap have peaks of their own. What may be a person does not raise the level: a residual that
is loud for long, one that leans on the arm, and of a single peak all but a tenth.
"""

from math import sqrt

import numpy as np

from common.arrays import Vector

# The level needed is _OF_RMS root mean squares, over _RMS_S of motion, starting from _AT_FIRST_S at
# which all of it was needed; and _OF_PEAK peaks, which decay in _PEAK_S. A residual that is loud
# for longer than _LASTS_S may be a person, and does not count.
_OF_RMS, _RMS_S, _AT_FIRST_S = 2.9, 300.0, 10.0
_OF_PEAK, _PEAK_S, _LASTS_S = 1.6, 300.0, 1.0
# A residual is loud beyond this share of the level in force; a peak counts after _QUIET_S of quiet.
_LOUD, _QUIET_S = 0.5, 0.3
# While a gap is crossed, and its raise exceeds the share _CROSSING of the level, peaks count
# separately, times _OF_CROSSING; they start at 1 and decay in _CROSSING_S of such motion.
_OF_CROSSING, _CROSSING_S, _CROSSING, _LEAST_CROSSING = 1.8, 20.0, 0.05, 0.7
# Largest factor by which one peak raises the level: it may have been a person after all.
_GROWS = 1.1
# Averaging time of the residual in motion [s]; that mean leans on the arm, and raises no level.
_LEANS_S = 5.0
# While friction is relearned only peaks raise the level, and decay in this time of motion.
_PASSES_S = 15.0
# Time at rest in which the root mean square is forgotten.
_RESTS_S = 7200.0
# Wrong masses, or a load, cause an error that grows with the torque that a joint carries. Motion
# has covered up to _OF_CARRIED root mean squares of that, and _OF_USUAL configured levels; beyond,
# the level grows in proportion.
_OF_CARRIED, _OF_USUAL = 1.7, 0.5
# Bound of a residual over the configured level: beyond, a sample was invalid, and must not last.
_LARGEST = 10.0


class NeededLevel:
    """Level shares of all joints. least (n,): least share of each configured level."""

    def __init__(self, least: Vector) -> None:
        n = len(least)
        self._least: Vector = least.copy()
        # Corrected residual in motion over the configured level: its integrated square with the
        # time of integration, and its peaks not explained by a raise.
        self.squares_s, self.moved_s = np.full(n, _AT_FIRST_S / _OF_RMS**2), np.full(n, _AT_FIRST_S)
        self.peak, self.crossing_peak = np.zeros(n), np.ones(n)
        # Integrated square of beta, the torque that the joint carries; its present value; reach.
        self.carried_s, self.carried, self.reach = np.zeros(n), np.zeros(n), np.ones(n)
        # Peaks that count only if it is quiet after them: a contact, too, begins below the level.
        self.peak_seen, self.crossing_seen = np.zeros((2, n))
        self.passing = np.zeros(n)  # peaks while friction is relearned
        self.lean = np.zeros(n)  # mean of the corrected residual in motion [Nm]
        self.quiet_s, self.loud_s = np.zeros((2, n))

    def level(self, i: int) -> float:
        """Share of the configured level that joint i needs in motion."""
        share = _OF_RMS * sqrt(self.squares_s[i] / self.moved_s[i])
        peak = max(self.peak[i], self.passing[i])
        return float(min(self.reach[i] * max(share, _OF_PEAK * peak, self._least[i]), 1.0))

    def crossing_level(self, i: int) -> float:
        """Share of the configured level that joint i needs while crossing its gap."""
        least = max(_LEAST_CROSSING, self._least[i])
        return float(min(max(_OF_CROSSING * self.crossing_peak[i], least), 1.0))

    def carry(self, i: int, beta: float, configured: float) -> None:
        """Set the torque `beta` that joint i carries; configured: its level [Nm]."""
        shown = _OF_CARRIED * sqrt(self.carried_s[i] / self.moved_s[i]) + _OF_USUAL * configured
        self.carried[i], self.reach[i] = beta, max(1.0, abs(beta) / shown)  # 1 for NaN

    def reset(self, i: int) -> None:
        """Restart from r = 0; what joint i needs is kept."""
        self.quiet_s[i] = self.loud_s[i] = 0.0
        self.peak_seen[i] = self.crossing_seen[i] = 0.0

    def note(
        self, i: int, corrected: float, level: float, configured: float, unknown: float,
        friction: float, raised: float, relearns: bool, moving: bool, dt: float,
    ) -> None:  # fmt: skip
        """Process the corrected residual of joint i over dt [s]. level, configured: contact
        levels in force and configured; unknown: torque of friction not yet learned; friction,
        raised: parts of the level in force for friction near rest and for transients [Nm];
        relearns: friction is being relearned: its residual soon ends, and needs no level."""
        size = abs(corrected)
        quiet = size <= _LOUD * level  # false for NaN
        self.quiet_s[i] = self.quiet_s[i] + dt if quiet else 0.0
        self.loud_s[i] = 0.0 if quiet else self.loud_s[i] + dt
        if not size <= level:
            self.loud_s[i] += _LASTS_S  # the decay after a contact is not the arm's own, either
        if self.loud_s[i] > _LASTS_S:
            self.peak_seen[i] = self.crossing_seen[i] = 0.0
        elif moving:
            self.passing[i] -= dt / _PASSES_S * self.passing[i]
            if raised > _CROSSING * configured:
                needed = (size - friction) / (configured + unknown)
                self.crossing_peak[i] -= dt / _CROSSING_S * self.crossing_peak[i]
                self.crossing_seen[i] = max(self.crossing_seen[i], needed)
            else:
                self._measure(i, corrected, configured, unknown, friction, relearns, dt)
        if self.quiet_s[i] > _QUIET_S:
            self._count(i, relearns)

    def rest(self, i: int, dt: float) -> None:
        """Let knowledge of joint i fade over dt [s] in which its motion showed nothing."""
        fade = dt / _RESTS_S
        self.squares_s[i] += fade * (_AT_FIRST_S / _OF_RMS**2 - self.squares_s[i])
        self.moved_s[i] += fade * (_AT_FIRST_S - self.moved_s[i])
        self.carried_s[i] -= fade * self.carried_s[i]

    def _measure(
        self, i: int, corrected: float, configured: float, unknown: float, friction: float,
        relearns: bool, dt: float,
    ) -> None:  # fmt: skip
        """Add a corrected residual [Nm] to the mean square and to the peak, both over the
        configured level. What leans on the arm raises neither."""
        fade, size = dt / _RMS_S, abs(corrected)
        alone = size - min(max(self.lean[i] if corrected > 0.0 else -self.lean[i], 0.0), size)
        self.lean[i] += dt / _LEANS_S * (corrected - self.lean[i])
        known = sqrt(self.squares_s[i] / self.moved_s[i]) * configured
        if abs(self.lean[i]) <= known and not relearns:
            square = min(max(alone, min(size, known)) / configured, _LARGEST)
            self.squares_s[i] += dt * square * square - fade * self.squares_s[i]
            self.moved_s[i] += dt - fade * self.moved_s[i]
            self.carried_s[i] += dt * self.carried[i] * self.carried[i] - fade * self.carried_s[i]
        self.peak[i] -= dt / _PEAK_S * self.peak[i]
        peak = max(alone, min(size, self.level(i) / _OF_PEAK * configured))
        self.peak_seen[i] = max(self.peak_seen[i], (peak - friction) / (configured + unknown))

    def _count(self, i: int, relearns: bool) -> None:
        """Count the peaks seen: it has been quiet since."""
        most = _GROWS * self.level(i) / _OF_PEAK
        if relearns:
            self.passing[i] = max(self.passing[i], min(self.peak_seen[i], most))
        else:
            self.peak[i] = max(self.peak[i], min(self.peak_seen[i], most))
        self.crossing_peak[i] = max(self.crossing_peak[i], self.crossing_seen[i])
        self.peak_seen[i] = self.crossing_seen[i] = 0.0
