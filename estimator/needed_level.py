# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Contact level that each joint needs: share of the configured one, from residuals in motion.

    share = reach max(2.9 rms, 1.6 peak, least), at most 1

of the corrected residual over the configured level, in the last minutes of motion. reach is 1, and
more in a pose in which the joint carries more than that motion has shown. A gap that is crossed has
peaks of its own. What may be a person raises nothing: what is loud for long, what leans
on the arm, and of one peak all but a tenth.
"""

from math import sqrt

import numpy as np

from common.arrays import Vector

# Of the level is needed what was _OF_RMS root mean squares, over _RMS_S of motion that began with
# _AT_FIRST_S at which all of it was; and _OF_PEAK peaks, which fade in _PEAK_S. What is loud
# for longer than _LASTS_S may be a person, and does not count.
_OF_RMS, _RMS_S, _AT_FIRST_S = 2.9, 300.0, 10.0
_OF_PEAK, _PEAK_S, _LASTS_S = 1.6, 300.0, 1.0
# Loud is what exceeds this share of the level in force; a peak counts after so much quiet.
_LOUD, _QUIET_S = 0.5, 0.3
# While a gap is crossed, and the raise for it lasts, _OF_CROSSING peaks count apart: they fade in
# so many seconds of that, from 1 on. It lasts as long as it is more than that share of the level.
_OF_CROSSING, _CROSSING_S, _CROSSING, _LEAST_CROSSING = 1.8, 20.0, 0.05, 0.7
# One peak raises the level by no more than this: it may have been a person all the same.
_GROWS = 1.1
# Mean of the residual over so much motion [s]: what leans on the arm, and raises no level.
_LEANS_S = 5.0
# While friction is learned anew only peaks raise the level, and fade in so much motion.
_PASSES_S = 15.0
# In so much rest the root mean square is forgotten.
_RESTS_S = 7200.0
# Wrong masses, or a load, put on a joint what grows with what it carries. Motion has shown it up to
# _OF_CARRIED root mean squares of that, and _OF_USUAL configured levels; beyond, as much more is
# needed.
_OF_CARRIED, _OF_USUAL = 1.7, 0.5
# Of the configured level: whatever is larger shows a sample that was none, and must not last.
_LARGEST = 10.0


class NeededLevel:
    """Shares of an arm's joints. least (n,): what of each configured level must be left."""

    def __init__(self, least: Vector) -> None:
        n = len(least)
        self._least: Vector = least.copy()
        # Of the corrected residual in motion, over the configured level: its square, and the time
        # over which that was integrated; and what of it no raise explained, at most.
        self.squares_s, self.moved_s = np.full(n, _AT_FIRST_S / _OF_RMS**2), np.full(n, _AT_FIRST_S)
        self.peak, self.crossing_peak = np.zeros(n), np.ones(n)
        # The square of what the model says it carries, likewise; that of now, and its reach.
        self.carried_s, self.carried, self.reach = np.zeros(n), np.zeros(n), np.ones(n)
        # Those that count when it was quiet after them: a contact begins below the level, too.
        self.peak_seen, self.crossing_seen = np.zeros((2, n))
        self.passing = np.zeros(n)  # peaks while friction is learned anew
        self.lean = np.zeros(n)  # mean of the corrected residual in motion [Nm]
        self.quiet_s, self.loud_s = np.zeros((2, n))

    def level(self, i: int) -> float:
        """Share of the configured level that joint i needs in motion."""
        share = _OF_RMS * sqrt(self.squares_s[i] / self.moved_s[i])
        peak = max(self.peak[i], self.passing[i])
        return float(min(self.reach[i] * max(share, _OF_PEAK * peak, self._least[i]), 1.0))

    def crossing_level(self, i: int) -> float:
        """Share of the configured level that joint i needs while it crosses its gap."""
        least = max(_LEAST_CROSSING, self._least[i])
        return float(min(max(_OF_CROSSING * self.crossing_peak[i], least), 1.0))

    def carry(self, i: int, beta: float, usual: float) -> None:
        """Let joint i be where it carries `beta`; usual: its configured level [Nm]."""
        shown = _OF_CARRIED * sqrt(self.carried_s[i] / self.moved_s[i]) + _OF_USUAL * usual
        self.carried[i], self.reach[i] = beta, max(1.0, abs(beta) / shown)  # NaN is 1

    def reset(self, i: int) -> None:
        """Begin with r = 0 anew; what joint i needs stays."""
        self.quiet_s[i] = self.loud_s[i] = 0.0
        self.peak_seen[i] = self.crossing_seen[i] = 0.0

    def note(
        self, i: int, corrected: float, level: float, usual: float, unknown: float,
        friction: float, raised: float, relearns: bool, moving: bool, dt: float,
    ) -> None:  # fmt: skip
        """Take the corrected residual of joint i over dt [s]; level, usual: contact levels in force
        and configured; unknown: what friction may make that is not learned; friction, raised: what
        the level in force has of friction near rest, and of what fades [Nm]; relearns: friction is
        learned anew, what shows of it is over soon, and no level is for it."""
        size = abs(corrected)
        quiet = size <= _LOUD * level  # NaN is not
        self.quiet_s[i] = self.quiet_s[i] + dt if quiet else 0.0
        self.loud_s[i] = 0.0 if quiet else self.loud_s[i] + dt
        if not size <= level:
            self.loud_s[i] += _LASTS_S  # what is left of a contact is none of the arm, either
        if self.loud_s[i] > _LASTS_S:
            self.peak_seen[i] = self.crossing_seen[i] = 0.0
        elif moving:
            self.passing[i] -= dt / _PASSES_S * self.passing[i]
            if raised > _CROSSING * usual:
                needed = (size - friction) / (usual + unknown)
                self.crossing_peak[i] -= dt / _CROSSING_S * self.crossing_peak[i]
                self.crossing_seen[i] = max(self.crossing_seen[i], needed)
            else:
                self._measure(i, corrected, usual, unknown, friction, relearns, dt)
        if self.quiet_s[i] > _QUIET_S:
            self._count(i, relearns)

    def rest(self, i: int, dt: float) -> None:
        """Know less of joint i after dt [s] in which its motion showed nothing."""
        fade = dt / _RESTS_S
        self.squares_s[i] += fade * (_AT_FIRST_S / _OF_RMS**2 - self.squares_s[i])
        self.moved_s[i] += fade * (_AT_FIRST_S - self.moved_s[i])
        self.carried_s[i] -= fade * self.carried_s[i]

    def _measure(
        self, i: int, corrected: float, usual: float, unknown: float, friction: float,
        relearns: bool, dt: float,
    ) -> None:  # fmt: skip
        """Put the size of a corrected residual [Nm], and what it needed, both over the configured
        level, to those before. What leans on the arm raises neither."""
        fade, size = dt / _RMS_S, abs(corrected)
        alone = size - min(max(self.lean[i] if corrected > 0.0 else -self.lean[i], 0.0), size)
        self.lean[i] += dt / _LEANS_S * (corrected - self.lean[i])
        known = sqrt(self.squares_s[i] / self.moved_s[i]) * usual
        if abs(self.lean[i]) <= known and not relearns:
            square = min(max(alone, min(size, known)) / usual, _LARGEST)
            self.squares_s[i] += dt * square * square - fade * self.squares_s[i]
            self.moved_s[i] += dt - fade * self.moved_s[i]
            self.carried_s[i] += dt * self.carried[i] * self.carried[i] - fade * self.carried_s[i]
        self.peak[i] -= dt / _PEAK_S * self.peak[i]
        peak = max(alone, min(size, self.level(i) / _OF_PEAK * usual))
        self.peak_seen[i] = max(self.peak_seen[i], (peak - friction) / (usual + unknown))

    def _count(self, i: int, relearns: bool) -> None:
        """Count the peaks seen: it was quiet after them."""
        most = _GROWS * self.level(i) / _OF_PEAK
        if relearns:
            self.passing[i] = max(self.passing[i], min(self.peak_seen[i], most))
        else:
            self.peak[i] = max(self.peak[i], min(self.peak_seen[i], most))
        self.crossing_peak[i] = max(self.crossing_peak[i], self.crossing_seen[i])
        self.peak_seen[i] = self.crossing_seen[i] = 0.0
