"""Parts of the estimator in arrays: samples, friction, intervals, residuals and contacts."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arrays import Matrix, Vector
from estimator.contact import Contact
from estimator.interval import ROW, TERMS
from estimator.link_velocity import DELAY_PERIODS, SAMPLES
from estimator.motor_position import Side
from estimator.residual import Form, forms
from estimator.settings import EstimatorSettings, Method, Variant
from estimator.thresholds import LEVELS, Thresholds
from estimator.transmission import CREEP, LINK_REST, Transmission, coulomb_viscous

FRICTIONS = slice(ROW["motor_friction"], ROW["gap_friction"] + 1)
"""Rows of an interval's terms: motor, link together with the motor, link alone, gap."""
_INCREMENTS = frozenset({"momentum", "rotor", "theta"})
_MISSING_SHARE, _MISSING_MOST = 0.4, 1.2
RAISED_PERIODS = 2.5
WAITS = 2
_SHORTEST_S = 1e-9
_CLEAR, _ABSENT = 0.35, 0.175


def parabola(last_interval: Vector, interval_before: Vector, delay: float) -> NDArray[np.float64]:
    """Weights (2, 3, n) that give position and velocity `delay` seconds before the newest sample.

    Times positions (3, n), newest first; the intervals (n,) [s] between them may differ.
    """
    h, whole = last_interval, last_interval + interval_before
    # Newton's form: slope of the last interval, and the curvature that bends it.
    bend = 1.0 / (h * whole), -1.0 / (h * interval_before), 1.0 / (interval_before * whole)
    x, v = -delay * (h - delay), h - 2.0 * delay
    return np.array(
        [
            [1.0 - delay / h + x * bend[0], delay / h + x * bend[1], x * bend[2]],
            [1.0 / h + v * bend[0], -1.0 / h + v * bend[1], v * bend[2]],
        ]
    )


ALIGNED = ("link_position", "link_velocity", "current", "motor_velocity", "motor_position")
"""Rows of what `Alignment.aligned` gives."""


class Alignment:
    """The last samples, and their values at one common instant `delay` seconds ago.

    A joint whose sample is missing goes on at its last velocity, with its last current. Each signal
    is older than its sample by a transport delay of its own [s]: the current by its drive's filter,
    the link position by its encoder's latency.
    """

    def __init__(
        self,
        n: int,
        method: Method,
        period: float,
        *,
        current_delay: float,
        link_delay: float,
        velocity_delay: float,
        position_delay: float,
    ) -> None:
        self._back = DELAY_PERIODS[method] * period
        self.delay = self._back + link_delay
        """The common instant lies this long before the newest sample arrived [s]."""
        self._current_age = self.delay - current_delay
        # Of the motor.
        self._velocity_age = self.delay - velocity_delay
        self._position_age = self.delay - position_delay
        self.count = np.zeros(n, dtype=np.int64)  # samples of each joint, at most SAMPLES
        self._period = period
        # Between the last samples of each joint [s].
        self.interval = np.full(n, period)
        self.interval_before = np.full(n, period)
        # Rows of a sample: current, motor velocity, motor position, link position; newest first.
        self.history: Matrix = np.zeros((SAMPLES * 4, n))
        self._ages = np.array([self._current_age, self._velocity_age, self._position_age])[:, None]

    @property
    def ready(self) -> NDArray[np.bool_]:
        """Joints (n,) whose link velocity is made of samples alone."""
        ready: NDArray[np.bool_] = self.count >= SAMPLES
        return ready

    def push(self, samples: Matrix, dt: Vector) -> None:
        """Take the samples of this tick, dt (n,) [s] after those before; 0 where there is none.

        samples: shape (4, n): current, motor velocity, motor position, link position.
        """
        came = dt > 0.0
        np.copyto(self.history[4:], self.history[:-4].copy(), where=came)
        np.copyto(self.history[:4], samples, where=came)
        np.copyto(self.interval_before, self.interval, where=came)
        np.copyto(self.interval, dt, where=came)
        first = came & (self.count == 0)
        if first.any():
            self._start(first)
        self.count += came
        np.minimum(self.count, SAMPLES, out=self.count)

    def _start(self, joints: NDArray[np.bool_]) -> None:
        """What was before the first samples of these joints (n,): as if their links had moved with
        their motors."""
        current, motor_velocity, motor_position, link = self.history[:4, joints]
        for ticks in range(1, SAMPLES):
            turned = ticks * self._period * motor_velocity
            rows = (current, motor_velocity, motor_position - turned, link - turned)
            self.history[4 * ticks : 4 * ticks + 4, joints] = rows
        self.interval[joints] = self.interval_before[joints] = self._period

    def aligned(
        self, out: Matrix, carried: Vector | None = None, absent: NDArray[np.bool_] | None = None
    ) -> None:
        """The rows of ALIGNED at the common instant into out (5, n).

        absent: joints (n,) without a sample in this tick; their values in `out`, of the tick
        before, are carried on for the time `carried` (n,) [s].
        """
        kept = None if absent is None else out[:, absent]
        weights = parabola(self.interval, self.interval_before, self._back)
        np.sum(weights * self.history[3::4], axis=1, out=out[:2])
        newest, before = self.history[:3], self.history[4:7]
        np.subtract(before, newest, out=out[2:])
        out[2:] *= self._ages / self.interval
        out[2:] += newest
        if absent is not None and kept is not None and carried is not None:
            kept[0] += kept[1] * carried[absent]
            kept[4] += kept[3] * carried[absent]
            out[:, absent] = kept

    def restart(self, joints: NDArray[np.bool_]) -> None:
        """Forget all samples of these joints (n,)."""
        self.count[joints] = 0
        self.history[:, joints] = 0.0


class FrictionTerms:
    """Coulomb and viscous friction of a transmission, one row per term of FRICTIONS."""

    def __init__(self, transmission: Transmission) -> None:
        t = transmission
        self._coulomb = np.stack([t.motor_coulomb, t.link_coulomb, t.link_coulomb, t.gap_coulomb])
        self._viscous = np.stack([t.motor_viscous, t.link_viscous, t.link_viscous, t.gap_viscous])
        self._width = t.sign_width
        self._velocities: Matrix = np.zeros((4, t.n))

    def at(self, q_dot: Vector, theta_dot: Vector, out: Matrix) -> None:
        """Write friction into out (4, n) [Nm], positive along the velocity: motor at theta_dot,
        link at theta_dot, link at q_dot, gap at phi_dot; each (n,) [rad/s]."""
        v = self._velocities
        v[:2] = theta_dot
        v[2] = q_dot
        np.subtract(q_dot, theta_dot, out=v[3])
        out[:] = coulomb_viscous(self._coulomb, self._viscous, v, self._width)


def displacement(
    theta_dot: Vector, q_dot: Vector, moved: Vector, has_gap: NDArray[np.bool_], dt: Vector
) -> Vector:
    """Displacement (n,) [rad] over dt (n,) [s] of rotors whose position is not measured; `moved` is
    that of their links. Where both creep, rotor and link are taken for one, as they are where there
    is no gap: a link's encoder does not drift."""
    alone = (np.abs(theta_dot) > CREEP) | (np.abs(q_dot) > LINK_REST)
    turned: Vector = np.where(alone & has_gap, theta_dot * dt, moved)
    return turned


class Stiction:
    """z of each joint as an interval, `ends` (2, n); from -1 ... 1 on, where nothing is known.

    presliding [rad], > 0: from no friction to all of it.
    """

    def __init__(self, n: int, presliding: float) -> None:
        self._per_presliding = 1.0 / presliding
        self.ends: Matrix = np.empty((2, n))
        self.restart()

    def restart(self, joints: NDArray[np.bool_] | slice = slice(None)) -> None:
        """Forget what the last motion left, of these joints or of all."""
        self.ends[0, joints], self.ends[1, joints] = -1.0, 1.0

    def step(self, displacement: Vector) -> None:
        """Move on by the rotor's displacement (n,) [rad]."""
        ends = self.ends
        ends += displacement * self._per_presliding
        np.minimum(np.maximum(ends, -1.0, out=ends), 1.0, out=ends)

    @property
    def z(self) -> Vector:
        """Share of the Coulomb friction that is held, signed as the motion that built it up."""
        middle: Vector = 0.5 * (self.ends[0] + self.ends[1])
        return middle

    @property
    def unknown(self) -> Vector:
        """Largest error of z: 1 where nothing is known, 0 after a motion."""
        half: Vector = 0.5 * (self.ends[1] - self.ends[0])
        return half


class Interval:
    """Values at both ends and the impulses of `forms`, shape (len(forms), n), of the last step.

    Write the values of an instant to the rows of `now`, (len(TERMS), n), after `begin`; those of
    the instant before are then in `before`. Where a joint has none, `keep` takes it out again.
    """

    def __init__(self, forms: Sequence[Form], n: int) -> None:
        terms = len(TERMS)
        self._ends: Matrix = np.zeros((2 * terms, n))
        self.now, self.before = self._ends[:terms], self._ends[terms:]
        self.impulses: Matrix = np.zeros((len(forms), n))
        self._fixed, self._per_second = np.zeros((2, len(forms), 2 * terms))
        self._increments: Matrix = np.zeros((len(forms), n))
        for form, fixed, per_second in zip(forms, self._fixed, self._per_second, strict=True):
            for name, weight in form.items():
                if name in _INCREMENTS:
                    fixed[[ROW[name], terms + ROW[name]]] = weight, -weight
                else:
                    per_second[[ROW[name], terms + ROW[name]]] = 0.5 * weight

    def begin(self) -> None:
        """Make the values of now those of the interval's beginning."""
        self.before[:] = self.now

    def keep(self, joints: NDArray[np.bool_]) -> None:
        """Take back what was written of these joints (n,): their interval goes on."""
        self.now[:, joints] = self.before[:, joints]

    def start(self, joints: NDArray[np.bool_]) -> None:
        """Begin anew with these joints (n,): nothing is known of the time before now."""
        self.before[:, joints] = self.now[:, joints]

    def step(self, dt: Vector) -> Matrix:
        """Impulses over the last dt (n,) [s]; overwritten by the next step. Zero where dt is 0 and
        both ends are the same."""
        np.dot(self._per_second, self._ends, out=self.impulses)
        np.multiply(self.impulses, dt, out=self.impulses)
        np.dot(self._fixed, self._ends, out=self._increments)
        return np.add(self.impulses, self._increments, out=self.impulses)

    def restart(self, joints: NDArray[np.bool_]) -> None:
        """Forget both ends of these joints (n,)."""
        self._ends[:, joints] = 0.0


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
    """Torques (n,) [Nm] that stiction may hold near rest, and that an unknown side, or samples that
    were missing, may pretend."""

    def __init__(
        self, transmission: Transmission, settings: EstimatorSettings, contact: Vector
    ) -> None:
        """contact: levels (n,) [Nm]."""
        t = transmission
        self._always = settings.stiction_share * t.engaged_coulomb
        self._held = t.stiction * t.engaged_coulomb
        self._missing, self._missing_most = _MISSING_SHARE * contact, _MISSING_MOST * contact
        self._unsure = settings.unknown_side_share * contact * (t.half_gap > 0.0)

    @property
    def most(self) -> Vector:
        """The raise (n,) [Nm] at rest with nothing known."""
        most: Vector = self._always + self._held + self._unsure
        return most

    def at(
        self,
        rest: Vector,
        unknown: Vector,
        side: NDArray[np.int8],
        periods: Vector | None = None,
    ) -> Vector:
        """The raise (n,) [Nm] in one tick.

        rest: `transmission.resting`; unknown: share of the stiction that may be anything; side:
        `Side`; periods: since the last sample, where one was missing; each (n,).
        """
        hidden = self._held * unknown
        hidden += self._always
        hidden *= rest
        hidden += self._unsure * (side == Side.UNKNOWN)
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
        self,
        joints: Sequence[str],
        thresholds: Thresholds,
        *,
        gain: float,
        debounce: int = 1,
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

    def thresholds(self, hidden: Vector, theta_dot: Vector, dt: float) -> Vector:
        """Contact thresholds in force [Nm], raised by what stiction may hide in this tick, `hidden`
        (n,) [Nm], and by `Thresholds.per_speed` in motion.

        After break-away friction still builds up while the residual forgets what stiction left in
        it, so the raise fades with half the residual's gain.
        """
        raised = self.raised
        np.multiply(raised, math.exp(-0.5 * self._gain * dt), out=raised)
        np.maximum(raised, hidden, out=raised)
        self._above = raised
        if self._per_speed is not None:
            self._above = raised + self._per_speed * np.abs(theta_dot)
        in_force: Vector = self._levels[0] + self._above
        return in_force

    def step(
        self,
        residual: Vector,
        side: NDArray[np.int8],
        time_s: float,
        absent: NDArray[np.bool_] | None = None,
    ) -> tuple[Contact, ...]:
        """Contacts that begin in this tick, at most one per joint and level.

        What counts of joints that are `absent` (n,), without a new sample, is what counted before.
        Beside them a contact waits, for `WAITS` ticks at most, for the tick that shows whether they
        went on as they were taken to: what they did else is a torque on the others until then.
        """
        levels = self._levels + self._above
        if absent is None and not np.count_nonzero(np.abs(residual) > levels[0]):
            self.streak[:] = 0
            self.waited[:] = 0
            return ()
        past = (residual > levels).astype(np.int64) - (residual < -levels)
        streak = np.where(past * self.streak > 0, self.streak + past, past)
        begins = np.abs(streak) == self._debounce
        if absent is not None:
            streak = np.where(absent, self.streak, streak)
            waits = begins & ~absent & (self.waited < WAITS)
            self.waited[waits] += 1
            streak = np.where(waits, self.streak, streak)
            begins &= ~absent & ~waits
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
