"""Plausibility checks on measured samples: encoders, torques, speeds, joint limits. Pure.

Arrays of shape (n,), SI at the link side; time is an argument. All bounds are compared in one
matrix, a row for each condition, so that an undisturbed tick costs a few tens of microseconds.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from arrays import Vector
from daemon.faults.finding import Finding
from daemon.faults.table import Condition

# What a half-gap may be wider than it was identified.
GAP_TOLERANCE: Final = 1.1
# A current has noise; one that is the same to the last bit for so many ticks, while the motor turns
# so far [rad], was not measured.
STUCK_TRAVEL: Final = 0.1
STUCK_TICKS: Final = 20
# Share of the current limit at which a drive is at its limit.
SATURATED_SHARE: Final = 0.95
# A knock may drag a motor along for a tick or two.
OVERSPEED_TICKS: Final = 3
# Slower than this a joint or a motor stands [rad/s]: a few counts of a coarse velocity, or its
# bias, are no motion.
STANDSTILL_SPEED: Final = 0.02

# Rows of the matrix, and figure and bound of each in words; of several at one joint the first is
# the nearest to the cause.
_ENERGISED_ONLY: Final = {
    Condition.JUMP: "by {:.3f} rad, at most {:.3f}",
    Condition.OVERSPEED: "for {:.0f} ticks, at most {:.0f}",
    Condition.TORQUE_STUCK: "while the motor turned by {:.3f} rad, at most {:.3f}",
    Condition.TORQUE_SATURATED: "for {:.0f} ticks, at most {:.0f}",
    Condition.RESIDUAL_LIMIT: "{:.1f} Nm, at most {:.1f}",
    Condition.JOINT_LIMIT: "{:.3f} rad from the middle, at most {:.3f}",
}
# These hold for an arm that is moved by hand, too.
_ALWAYS: Final = {
    Condition.FROZEN: "while the motor turned by {:.3f} rad, at most {:.3f}",
    Condition.APART: "by {:.3f} rad, at most {:.3f}",
}
_FIGURES: Final = _ENERGISED_ONLY | _ALWAYS
_ROWS: Final = tuple(_FIGURES)
# Rows of what is compared with the tick before.
_Q, _CURRENT = 0, 1


@dataclass(frozen=True, slots=True)
class PlausibilitySettings:
    """Bounds on what each joint may show, arrays of shape (n,)."""

    lower: Vector  # joint limits [rad]
    upper: Vector
    speed: Vector  # of motor and link [rad/s]
    half_gap: Vector  # [rad]
    position_margin: float  # encoder noise, and the gear's deflection [rad]
    current: Vector  # the drives' limit [A]
    residual: Vector  # [Nm]
    saturated_ticks: int
    motor_drift: float  # of an integrated motor position, beside a share of the speed [rad/s]
    motor_scale_error: float  # that share


class Plausibility:
    """Compares the samples of each joint with the bounds, and with those before them."""

    def __init__(self, joints: Sequence[str], settings: PlausibilitySettings) -> None:
        self._joints, self._settings = tuple(joints), settings
        n = len(self._joints)
        self._middle = 0.5 * (settings.upper + settings.lower)
        self._play = 2.0 * GAP_TOLERANCE * settings.half_gap + settings.position_margin
        bound_of = {
            Condition.JUMP: self._play,  # and what the joint travels in dt
            Condition.OVERSPEED: np.full(n, OVERSPEED_TICKS - 1.0),
            Condition.TORQUE_STUCK: np.full(n, STUCK_TRAVEL),
            Condition.TORQUE_SATURATED: np.full(n, settings.saturated_ticks - 1.0),
            Condition.RESIDUAL_LIMIT: settings.residual,
            Condition.JOINT_LIMIT: 0.5 * (settings.upper - settings.lower)
            + settings.position_margin,
            # What repeats to the last bit has no noise.
            Condition.FROZEN: self._play - 0.5 * settings.position_margin,
            Condition.APART: self._play,
        }
        self._bounds = np.stack([bound_of[condition] for condition in _ROWS])
        self._jump_bound = self._bounds[_ROWS.index(Condition.JUMP)]
        self._measures = np.zeros_like(self._bounds)
        row_of = dict(zip(_ROWS, self._measures, strict=True))
        self._jump = row_of[Condition.JUMP]
        self._overspeed = row_of[Condition.OVERSPEED]
        self._stuck = row_of[Condition.TORQUE_STUCK]
        self._saturated = row_of[Condition.TORQUE_SATURATED]
        self._residual = row_of[Condition.RESIDUAL_LIMIT]
        self._outside = row_of[Condition.JOINT_LIMIT]
        self._frozen = row_of[Condition.FROZEN]
        self._apart = row_of[Condition.APART]
        self._energised_only = self._measures[: len(_ENERGISED_ONLY)]
        # Ticks in a row at the current limit, beyond the speed, and with one current; they go on
        # while the size, in the same row, is at its level.
        self._lasting, self._sizes = np.zeros((2, 3, n))
        self._full_ticks, self._fast_ticks, self._same_ticks = self._lasting
        self._current_size, self._speed_size, self._same_size = self._sizes
        self._levels = np.stack([SATURATED_SHARE * settings.current, settings.speed, np.ones(n)])
        self._started = False
        self._dt = np.zeros(n)
        self._theta, self._advance, self._phi, self._scratch = np.zeros((4, n))
        self._lowest, self._highest = np.zeros((2, n))  # of q - theta
        self._values, self._before = np.zeros((2, 2, n))  # q, current: now, and a tick ago
        self._velocity = np.zeros(n)
        self._turned = np.zeros((2, n))  # motor's way since q, or the current, changed

    def restart(self) -> None:
        """Forget the samples before: the next are believed, whatever they are."""
        self._started = False

    def step(
        self,
        q: Vector,
        motor_velocity: Vector,
        motor_position: Vector | None,
        current: Vector,
        residual: Vector,
        dt: Vector,
        energised: bool,
    ) -> tuple[Finding, ...]:
        """Everything that cannot be true of these samples, dt (n,) [s] after those before; where dt
        is 0 they are those before, and prove nothing."""
        values, before = self._values, self._before = self._before, self._values
        values[_Q], values[_CURRENT] = q, current
        self._turn(motor_velocity, motor_position, dt)
        if not self._started:
            self._start()
        phi = np.subtract(q, self._theta, out=self._phi)
        np.maximum(self._highest, phi, out=self._highest)
        np.minimum(self._lowest, phi, out=self._lowest)
        np.subtract(self._highest, self._lowest, out=self._apart)

        turned = self._turned
        turned += self._advance
        same = values == before
        turned *= same
        self._frozen[:], self._stuck[:] = turned

        if energised:
            sizes, lasting, jump = self._sizes, self._lasting, self._jump
            self._velocity[:] = motor_velocity
            self._current_size[:], self._speed_size[:] = current, motor_velocity
            self._same_size[:] = same[_CURRENT]
            np.abs(sizes, out=sizes)
            lasting += dt > 0.0
            lasting *= sizes >= self._levels
            self._saturated[:], self._overspeed[:] = self._full_ticks, self._fast_ticks
            np.subtract(q, before[_Q], out=jump)
            jump -= self._advance
            self._residual[:] = residual
            np.subtract(q, self._middle, out=self._outside)
            self._dt = dt
            np.multiply(self._settings.speed, dt, out=self._jump_bound)
            self._jump_bound += self._play
        else:
            self._energised_only.fill(0.0)
            self._lasting.fill(0.0)
            turned[_CURRENT] = 0.0
        np.abs(self._measures, out=self._measures)
        beyond = self._measures > self._bounds
        return tuple(self._findings(beyond)) if np.count_nonzero(beyond) else ()

    def _turn(self, motor_velocity: Vector, motor_position: Vector | None, dt: Vector) -> None:
        """Move theta, and keep by how much."""
        if motor_position is not None:
            np.subtract(motor_position, self._theta, out=self._advance)
            self._theta[:] = motor_position
            return
        np.multiply(motor_velocity, dt, out=self._advance)
        np.abs(motor_velocity, out=self._scratch)
        self._advance *= self._scratch > STANDSTILL_SPEED
        self._theta += self._advance
        # An integral drifts: what it was long ago says less and less of where the gap is.
        s = self._settings
        drift = s.motor_drift * dt + s.motor_scale_error * np.abs(self._advance)
        # A motor this slow may turn, or its velocity be biased: both are taken for possible.
        drift += np.abs(motor_velocity * dt - self._advance)
        self._highest -= drift
        self._lowest += drift

    def _start(self) -> None:
        self._started = True
        np.subtract(self._values[_Q], self._theta, out=self._lowest)
        self._highest[:] = self._lowest
        self._before[:] = self._values
        self._advance.fill(0.0)
        self._turned.fill(0.0)
        self._lasting.fill(0.0)

    def _findings(self, beyond: NDArray[np.bool_]) -> Iterator[Finding]:
        for row, joint in zip(*np.nonzero(beyond), strict=True):
            condition = _ROWS[row]
            if condition is Condition.JOINT_LIMIT and not self._goes_outwards(joint):
                continue
            if condition is Condition.TORQUE_STUCK and self._same_ticks[joint] < STUCK_TICKS:
                continue
            if condition is Condition.OVERSPEED and self._brakes(joint):
                self._fast_ticks[joint] = 0.0
                continue
            figure, bound = self._measures[row, joint], self._bounds[row, joint]
            yield Finding(condition, self._joints[joint], _FIGURES[condition].format(figure, bound))

    def _goes_outwards(self, joint: int) -> bool:
        q, before = self._values[_Q, joint], self._before[_Q, joint]
        side = 1.0 if q > self._middle[joint] else -1.0
        return bool(side * (q - before) > STANDSTILL_SPEED * self._dt[joint])

    def _brakes(self, joint: int) -> bool:
        """Somebody is stronger than the motor, which resists with half its current or more."""
        driving = np.sign(self._velocity[joint]) * self._values[_CURRENT, joint]
        return bool(driving < -0.5 * self._settings.current[joint])
