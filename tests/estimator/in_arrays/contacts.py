"""Parts of the estimator in arrays: residuals, their thresholds, and contacts."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from estimator.contact import Contact
from estimator.motor_position import Side
from estimator.residual import Form, forms
from estimator.settings import EstimatorSettings, Variant
from estimator.thresholds import LEVELS, Thresholds
from estimator.transmission import Transmission

_MISSING_SHARE, _MISSING_MOST = 0.4, 1.2
RAISED_PERIODS = 2.5
WAITS = 2
_SHORTEST_S = 1e-9
_CLEAR, _ABSENT = 0.35, 0.175


class Residual:
    """Several variants side by side on the same impulses; `values[i]` belongs to `variants[i]`.

    Raises ModelError for gain * period >= 2, where the pole of (13) would be negative and the
    residual would ring, and for variants that are alike or contradict themselves.
    """

    def __init__(self, variants: Sequence[Variant], gain: float, period: float, n: int) -> None:
        self.variants = tuple(variants)
        self.gain = gain
        self.values: Matrix = np.zeros((len(variants), n))
        # Rows of `forms`: the parts that always act, then those that act while engaged.
        self.always, self.engaged = slice(len(variants)), slice(len(variants), None)
        self._error = np.zeros_like(self.values)

    def forms(self) -> list[Form]:
        """The sums that an `Interval` makes for `step`: every variant's part that always acts, then
        every variant's part that acts while engaged."""
        always, engaged = zip(*map(forms, self.variants), strict=True)
        return [*always, *engaged]

    def step(self, impulses: Matrix, engaged: Vector, dt: Vector) -> Matrix:
        """Advance by one interval of dt (n,) [s]; returns `values`, overwritten by the next step.

        impulses: those of `forms`, shape (2 * variants, n) [Nm s], finite, and zero where dt is;
        engaged: (n,), 1 where rotor and link touched, 0 where they were apart. With dt beyond
        2 / gain the pole is clamped at zero: the residual is then the mean external torque of the
        interval.
        """
        error, TK = self._error, self.gain * dt
        np.multiply(impulses[self.engaged], engaged, out=error)
        np.add(error, impulses[self.always], out=error)
        # At TK = 2, K e T / T = e / T, and beyond it the pole stays there.
        pole = np.maximum((2.0 - TK) / (2.0 + TK), 0.0)
        error *= np.minimum(2.0 * self.gain / (2.0 + TK), 1.0 / np.maximum(dt, _SHORTEST_S))
        self.values *= pole
        self.values += error
        return self.values

    def reset(self, joints: NDArray[np.bool_] | slice = slice(None)) -> None:
        """Forget the external torque on these joints, or on all: r = 0."""
        self.values[:, joints] = 0.0


class ThresholdRaise:
    """Torques (n,) [Nm] that an unknown side, or samples that were missing, may pretend; and
    friction that may be off near rest, filtered as the residual."""

    def __init__(
        self, transmission: Transmission, settings: EstimatorSettings, contact: Vector
    ) -> None:
        """contact: levels (n,) [Nm]."""
        t = transmission
        self._gain, self._coulomb = settings.gain, t.engaged_coulomb
        self._always = settings.stiction_share * t.engaged_coulomb
        self._begin, self.friction = np.zeros((2, t.n))
        self._missing, self._missing_most = _MISSING_SHARE * contact, _MISSING_MOST * contact
        self._unsure = settings.unknown_side_share * contact * (t.half_gap > 0.0)

    @property
    def most(self) -> Vector:
        """The raise (n,) [Nm] at rest with nothing known."""
        most: Vector = self._always + self._coulomb + self._unsure
        return most

    def rub(self, rest: Vector, unknown: Vector, dt: Vector, ends: NDArray[np.bool_]) -> None:
        """Filter the friction that may be off by (13) over intervals dt (n,) [s]; those of `ends`
        (n,) begin anew. rest: `transmission.resting`; unknown: share of the stiction."""
        now = self._coulomb * unknown + self._always * rest**4
        TK = self._gain * dt
        pole = np.maximum((2.0 - TK) / (2.0 + TK), 0.0)
        share = np.minimum(2.0 * self._gain / (2.0 + TK), 1.0 / np.maximum(dt, _SHORTEST_S))
        filtered = pole * self.friction + share * 0.5 * dt * (now + self._begin)
        self.friction = np.where(dt > 0.0, filtered, self.friction)
        self._begin = np.where(ends, now, self._begin)

    def at(self, side: NDArray[np.int8], periods: Vector | None = None) -> Vector:
        """The raise (n,) [Nm] in one tick. side: `Side`; periods: since the last sample, where one
        was missing; each (n,)."""
        hidden: Vector = self._unsure * (side == Side.UNKNOWN)
        if periods is not None:
            beyond = np.maximum(periods - 2.0, 0.0)
            hidden += np.minimum(beyond * self._missing, self._missing_most)
        return hidden


class ContactDetector:
    """Thresholds in force, debounce and events.

    A contact begins when |r| has been past a level on one side for `debounce` ticks in a row; it
    ends when r comes back or changes its sign, and only then may the level fire again.

    gain: of the residual [1/s].
    """

    def __init__(
        self, joints: Sequence[str], thresholds: Thresholds, *, gain: float, debounce: int = 1
    ) -> None:
        n = len(joints)
        self._joints = tuple(joints)
        self._levels = np.stack([thresholds.contact, thresholds.collision])
        self._per_speed = thresholds.per_speed if np.any(thresholds.per_speed) else None
        self._gain = gain
        self._debounce = debounce
        self.raised = np.zeros(n)
        self._above = self.raised  # what is added to both levels in this tick
        # Ticks in a row past each level, signed as the residual.
        self.streak = np.zeros((2, n), dtype=np.int64)
        # Ticks for which a contact has waited for the sample of another joint.
        self.waited = np.zeros((2, n), dtype=np.int64)

    def thresholds(
        self, hidden: Vector, friction: Vector | float, theta_dot: Vector, dt: float
    ) -> Vector:
        """Contact thresholds in force [Nm], raised by `hidden` (n,) [Nm], which fades with half the
        residual's gain, by `friction` (n,) [Nm] and by `Thresholds.per_speed` in motion."""
        raised = self.raised
        np.multiply(raised, math.exp(-0.5 * self._gain * dt), out=raised)
        np.maximum(raised, hidden, out=raised)
        self._above = raised + friction
        if self._per_speed is not None:
            self._above = self._above + self._per_speed * np.abs(theta_dot)
        in_force: Vector = self._levels[0] + self._above
        return in_force

    def step(
        self,
        residual: Vector,
        side: NDArray[np.int8],
        time_s: float,
        absent: NDArray[np.bool_] | None = None,
        late: NDArray[np.bool_] | None = None,
    ) -> tuple[Contact, ...]:
        """Contacts that begin in this tick, at most one per joint and level.

        What counts of joints that are `absent` (n,), without a new sample, is what counted before.
        Beside them a contact waits, for `WAITS` ticks at most, for the tick that shows whether they
        went on as they were taken to: what they did else is a torque on the others until then. So
        it does where its own interval is `late` (n,).
        """
        levels = self._levels + self._above
        if absent is None and not np.count_nonzero(np.abs(residual) > levels[0]):
            self.streak[:] = 0
            self.waited[:] = 0
            return ()
        past = (residual > levels).astype(np.int64) - (residual < -levels)
        streak = np.where(past * self.streak > 0, self.streak + past, past)
        begins = np.abs(streak) == self._debounce
        waits = begins & (self.waited < WAITS)
        if absent is not None:
            streak = np.where(absent, self.streak, streak)
            begins &= ~absent
            waits &= ~absent
        else:
            waits &= False if late is None else late
        self.waited[waits] += 1
        streak = np.where(waits, self.streak, streak)
        begins &= ~waits
        self.waited *= (past != 0) & ~begins
        self.streak[:] = streak
        if not begins.any():
            return ()
        return tuple(
            Contact(
                joint=self._joints[i],
                torque=float(residual[i]),
                threshold=float(levels[level, i]),
                level=LEVELS[level],
                side=int(side[i]),
                time_s=time_s,
            )
            for level, i in np.argwhere(begins)
        )

    def reset(self, joints: NDArray[np.bool_] | slice = slice(None)) -> None:
        """Forget the raise and all contacts, of these joints or of all."""
        self.raised[joints] = 0.0
        self.streak[:, joints] = 0
        self.waited[:, joints] = 0


def touched_link(residual: Vector, contact: Vector) -> int | None:
    """Index of the joint whose link is touched, for a residual (n,) [Nm] that is past the contact
    level (n,) [Nm] of at least one joint.

    None where it cannot be decided: no residual is clear, or that of a joint further out is neither
    clear nor clearly absent.
    """
    strength = np.abs(residual) / contact
    clear = np.flatnonzero(strength > _CLEAR)
    if not clear.size:
        return None
    last = int(clear[-1])
    return None if np.any(strength[last + 1 :] > _ABSENT) else last
