"""Parts of the estimator in arrays: samples, friction, and the impulses of an interval."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from estimator.interval import ROW, TERMS
from estimator.link_velocity import DELAY_PERIODS, SAMPLES
from estimator.residual import Form
from estimator.settings import Method
from estimator.transmission import CREEP, LINK_REST, Transmission, coulomb_viscous

FRICTIONS = slice(ROW["motor_friction"], ROW["gap_friction"] + 1)
"""Rows of an interval's terms: motor, link together with the motor, link alone, gap."""
_INCREMENTS = frozenset({"momentum", "rotor", "theta"})


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
    """z of each joint as an interval for each of five pre-slidings, `ends` (2, 5, n); from -1 ... 1
    on, where nothing is known.

    presliding [rad], > 0: shortest and longest way from no friction to all of it.
    """

    def __init__(
        self, n: int, presliding: tuple[float, float], least: Vector, most: Vector
    ) -> None:
        self._per_presliding = 1.0 / np.geomspace(*presliding, 5)[:, np.newaxis]
        self._range = np.array([least, most])
        self.ends: Matrix = np.empty((2, 5, n))
        self.restart()
        self.held, self.unknown = np.zeros(n), most.copy()

    def restart(self, joints: NDArray[np.bool_] | slice = slice(None)) -> None:
        """Forget what the last motion left, of these joints or of all."""
        self.ends[0][:, joints], self.ends[1][:, joints] = -1.0, 1.0

    def step(self, displacement: Vector, sign: Vector) -> None:
        """Move on by the rotor's displacement (n,) [rad]; sign: s(theta_dot)."""
        ends = self.ends
        ends += displacement * self._per_presliding
        np.minimum(np.maximum(ends, -1.0, out=ends), 1.0, out=ends)
        low = (self._range * (ends[0].min(axis=0) - sign)).min(axis=0)
        high = (self._range * (ends[1].max(axis=0) - sign)).max(axis=0)
        self.held, self.unknown = 0.5 * (low + high), 0.5 * (high - low)


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
