# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Doubt in what was learned, raised by contacts that the stated level would not have shown.

Both a level lowered by learning and learned friction are inferences. A contact that depends on them
may come from the arm itself: changed friction, a cable, a load. After it the joint returns to its
stated level, and its friction counts as unknown,

    k' = k + (1 - k) d,    unknown' >= d * unknown before anything was learned

until its motion agrees again. Doubt everywhere (d) ends after half a second of agreeing motion in
each direction that was interrupted; doubt at the `place` of the contact, only after the joint has
passed there without another. A direction that was not interrupted proves nothing: what rubs in one
direction agrees in the other. A joint that moves after a minute of rest is in doubt, too, until
both directions agree: its gear may have cooled. If the residual keeps exceeding the lowered level,
with a sign that follows the direction of motion, it is friction: what was learned of it becomes
uncertain again, and is discarded if the residual is smaller without it.

A hand presses suddenly, and firmly. A residual that crept over the lowered level, and hardly beyond
it, is more likely the arm's own, and will recur in similar poses: then all levels get a margin m, k
(1 + m), which doubles when the same joint grazes its level again. It fades during motion that would
have stayed below the level without it.

A contact beyond the stated level and all identified friction raises no doubt: it is a person, or an
obstacle. Doubt only raises levels; it moves nothing.
"""

import numpy as np

# Each interrupted direction owes _HOLDS_S of agreeing motion; then d fades in _FADES_S.
_HOLDS_S, _FADES_S = 0.5, 0.5
# A doubtful contact that lasts longer, such as a cable on an arm at rest, is ended as d rises.
_LASTS_S, _RISES_S = 10.0, 1.0
# A contact that recurs within this time is the same one: a hand that pulls with about a level. At
# most the shortest quiet time, after which an arm resumes and is interrupted anew.
_APART_S = 0.1
# A residual crept over the lowered level if it was beyond the share _NEAR of it for _CREEPS_S
# within the last _NEAR_S; it grazed the level if it never reached _GRAZES times it.
_CREEPS_S, _NEAR_S, _NEAR, _GRAZES = 0.2, 0.5, 0.7, 1.3
# Margin after a graze; that of the grazing joint also doubles, up to _MOST_MARGIN. It decays in
# _MARGIN_S of motion, after _NEEDED_S of motion in which no residual exceeded _NEEDED of the level.
_MARGIN, _MOST_MARGIN = 0.4, 4.0
_MARGIN_S, _NEEDED_S, _NEEDED = 10.0, 18.0, 0.9
# Margin from which on motion is compared with what was learned, too.
_SOME = 0.05
# Width of a place to either side [rad]; agreeing motion there until it is forgotten, and until one
# that was met again is.
_WIDTH, _CLEARS_S, _CLEARS_AGAIN_S = 0.08, 1.0, 2.0
# Time beyond the lowered level in each direction of motion that proves friction.
_FLIPS_S = 0.05
# Verdicts of `step`.
AGREES, ENDED, GRAZED, FRICTION = range(4)
_AGREES, _ENDED, _GRAZED, _FRICTION = range(4)  # for the compiler


class Doubt:
    """Doubt d of each joint, `value` (n,), 0 to 1."""

    def __init__(self, n: int) -> None:
        # Duration of a doubtful contact; negative: time until one that ended counts as over [s].
        self.value, self.lasted_s = np.zeros((2, n))
        # Agreeing motion owed, by direction [s]; direction in which the contact began, 0 at rest.
        self.upwards_owed_s, self.downwards_owed_s = np.zeros((2, n))
        self.way = np.zeros(n, dtype=np.int64)
        # 1 where the present contact is beyond doubt, and where a place is known.
        self.beyond, self.placed = np.zeros((2, n), dtype=np.int64)
        # How long the residual was near the lowered level recently [s]; its largest ratio to that
        # in this contact; margin of the level, and how long it is still needed [s].
        self.near_s, self.depth, self.margin, self.needed_s = np.zeros((4, n))
        self.rubs = np.zeros(n, dtype=np.int64)  # 1: friction was found to have changed
        self.moving = np.zeros(n, dtype=np.int64)  # 1 while rotor and link move together
        self.low, self.high, self.cleared_s = np.zeros((3, n))  # of the place [rad, s]
        # Signed time for which the residual exceeded the lowered level, by direction of motion [s].
        self.upwards_s, self.downwards_s = np.zeros((2, n))
        # How often motion at the same place disagreed anew, and how often it interrupted the arm;
        # motion since it was left [s].
        self.met, self.interrupted = np.zeros((2, n), dtype=np.int64)
        self.away_s = np.zeros(n)

    def at(self, i: int, q: float) -> float:
        """Doubt of joint i at q [rad]."""
        if self.placed[i] and self.low[i] - _WIDTH <= q <= self.high[i] + _WIDTH:
            return 1.0
        return float(self.value[i])

    def step(
        self, i: int, touched: bool, q: float, velocity: float, residual: float, believed: float,
        lowered: float, stated: float, dt: float,
    ) -> int:  # fmt: skip
        """Process one tick of joint i, dt [s]; returns a verdict.

        touched: its contact is on; residual: the one that decides [Nm]; believed: the part of its
        magnitude that does not depend on learning [Nm]; lowered: level in force without doubt and
        margin [Nm]; stated: level that only a person or an obstacle exceeds [Nm].
        """
        depth = abs(residual) / (lowered * (1.0 + self.margin[i]))
        if touched:
            self.depth[i] = max(self.depth[i], depth)
            return self._last(i, velocity, believed, stated, dt)
        grazed = self.depth[i] < _GRAZES and self.near_s[i] > _CREEPS_S
        self.near_s[i] = min(max(self.near_s[i] + (dt if depth > _NEAR else -dt), 0.0), _NEAR_S)
        self.depth[i] = 0.0
        if depth * (1.0 + self.margin[i]) > _NEEDED:
            self.needed_s[i] = _NEEDED_S
        elif self.moving[i]:
            self.needed_s[i] = max(self.needed_s[i] - dt, 0.0)
            if self.needed_s[i] <= 0.0:
                self.margin[i] -= dt / _MARGIN_S * self.margin[i]
        if self.lasted_s[i] > 0.0:
            self.lasted_s[i] = 0.0
            if self.beyond[i]:
                self.beyond[i] = 0
                return _AGREES
            self.lasted_s[i] = -_APART_S
            self.raise_at(i, q)
            return _GRAZED if grazed else _ENDED
        if self.lasted_s[i] < 0.0:
            self.lasted_s[i] = min(self.lasted_s[i] + dt, 0.0)
            if self.lasted_s[i] >= 0.0 and self.placed[i]:
                self.met[i] += 1
                self.interrupted[i] += 1
        if self.moving[i] and (self.value[i] > 0.0 or self.placed[i] or self.margin[i] > _SOME):
            return self._compare(i, q, velocity, residual, lowered, dt)
        return _AGREES

    def raise_at(self, i: int, q: float) -> None:
        """Doubt joint i everywhere, and around q [rad] until the joint has passed there."""
        self.value[i] = 1.0
        self._owe(i, self.way[i])
        near = self.placed[i] and self.low[i] - 2.0 * _WIDTH <= q <= self.high[i] + 2.0 * _WIDTH
        self.low[i] = min(self.low[i], q) if near else q
        self.high[i] = max(self.high[i], q) if near else q
        if not near:
            self.met[i] = self.interrupted[i] = 0
        self.placed[i], self.cleared_s[i], self.away_s[i] = 1, 0.0, 0.0

    def raise_all(self, i: int) -> None:
        """Doubt joint i everywhere, until both directions agree."""
        self.value[i] = 1.0
        self._owe(i, 0)

    def widen(self, i: int, own: bool) -> None:
        """Widen the margin of joint i after a graze by this joint (`own`), or by another."""
        if own:
            self.margin[i] = min(2.0 * self.margin[i] + _MARGIN, _MOST_MARGIN)
        else:
            self.margin[i] = max(self.margin[i], _MARGIN)

    def reset(self, i: int) -> None:
        """Forget the present contact of joint i."""
        self.lasted_s[i], self.depth[i], self.beyond[i] = 0.0, 0.0, 0

    def _owe(self, i: int, way: int) -> None:
        """Require agreeing motion of joint i in the direction `way`, in both if that is 0."""
        self.upwards_s[i] = self.downwards_s[i] = 0.0
        if way >= 0:
            self.upwards_owed_s[i] = _HOLDS_S
        if way <= 0:
            self.downwards_owed_s[i] = _HOLDS_S

    def _last(self, i: int, velocity: float, believed: float, stated: float, dt: float) -> int:
        if self.lasted_s[i] <= 0.0:
            self.lasted_s[i] = 0.0
            self.way[i] = 0
            if self.moving[i]:
                self.way[i] = 1 if velocity > 0.0 else -1
        self.lasted_s[i] += dt
        if believed > stated:
            self.beyond[i] = 1
        if not self.beyond[i] and self.lasted_s[i] > _LASTS_S:
            self.value[i] = min(self.value[i] + dt / _RISES_S, 1.0)
        return _AGREES

    def _compare(
        self, i: int, q: float, velocity: float, residual: float, lowered: float, dt: float
    ) -> int:
        """Compare motion with what was learned."""
        here = self.placed[i] and self.low[i] - _WIDTH <= q <= self.high[i] + _WIDTH
        agrees = abs(residual) <= lowered
        if here:
            self._pass(i, q, agrees, dt)
        else:
            self.away_s[i] += dt
        if agrees:
            self._agree(i, velocity, dt)
            return _AGREES
        if self.value[i] > 0.0 and (self.value[i] >= 1.0 or not here):
            self.value[i] = 1.0
            if velocity > 0.0:
                self.upwards_owed_s[i] = _HOLDS_S
            else:
                self.downwards_owed_s[i] = _HOLDS_S
        signed = dt if residual > 0.0 else -dt
        if velocity > 0.0:
            self.upwards_s[i] += signed
        else:
            self.downwards_s[i] += signed
        if self.upwards_s[i] > _FLIPS_S and self.downwards_s[i] < -_FLIPS_S:
            return self._rub(i)
        if self.upwards_s[i] < -_FLIPS_S and self.downwards_s[i] > _FLIPS_S:
            return self._rub(i)
        return _AGREES

    def _agree(self, i: int, velocity: float, dt: float) -> None:
        """Count motion that agrees."""
        if velocity > 0.0:
            self.upwards_owed_s[i] = max(self.upwards_owed_s[i] - dt, 0.0)
        else:
            self.downwards_owed_s[i] = max(self.downwards_owed_s[i] - dt, 0.0)
        if self.upwards_owed_s[i] <= 0.0 and self.downwards_owed_s[i] <= 0.0:
            self.value[i] = max(self.value[i] - dt / _FADES_S, 0.0)
            if self.value[i] <= 0.0:
                self.rubs[i] = 0

    def _rub(self, i: int) -> int:
        """Conclude that friction has changed."""
        self.raise_all(i)
        self.rubs[i] = 1
        return _FRICTION

    def _pass(self, i: int, q: float, agrees: bool, dt: float) -> None:
        """Update the place of joint i while it passes through."""
        if agrees:
            self.cleared_s[i] += dt
            if self.cleared_s[i] > (_CLEARS_S if self.met[i] < 2 else _CLEARS_AGAIN_S):
                self.placed[i] = self.met[i] = self.interrupted[i] = 0
            return
        if self.away_s[i] > 0.0:
            self.met[i] += 1
        self.cleared_s[i] = self.away_s[i] = 0.0
        self.low[i], self.high[i] = min(self.low[i], q), max(self.high[i], q)
