"""Whether what the drives measured can be true: encoders, torques, speeds, limits. Pure.

Arrays of shape (n,), SI at the link side; time is an argument. All bounds are compared in one
matrix, a row for each condition, so that an undisturbed tick costs a few tens of microseconds.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from arrays import Vector
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
# Slower than this a motor stands [rad/s]: a bias of its velocity is no motion.
STANDSTILL_SPEED: Final = 0.02

# Rows of the matrix; of several at one joint the first is the nearest to the cause. The last two
# hold for an arm that is moved by hand, too.
_ROWS: Final = (
    Condition.JUMP,
    Condition.OVERSPEED,
    Condition.TORQUE_STUCK,
    Condition.TORQUE_SATURATED,
    Condition.RESIDUAL_LIMIT,
    Condition.JOINT_LIMIT,
    Condition.FROZEN,
    Condition.APART,
)
_FIGURES: Final = {
    Condition.APART: "by {:.3f} rad, at most {:.3f}",
    Condition.FROZEN: "while the motor turned by {:.3f} rad, at most {:.3f}",
    Condition.TORQUE_STUCK: "while the motor turned by {:.3f} rad, at most {:.3f}",
    Condition.TORQUE_SATURATED: "for {:.0f} ticks, at most {:.0f}",
    Condition.JUMP: "by {:.3f} rad, at most {:.3f}",
    Condition.OVERSPEED: "for {:.0f} ticks, at most {:.0f}",
    Condition.RESIDUAL_LIMIT: "{:.1f} Nm, at most {:.1f}",
    Condition.JOINT_LIMIT: "{:.3f} rad from the middle, at most {:.3f}",
}


@dataclass(frozen=True, slots=True)
class PlausibilitySettings:
    """What each joint may show, arrays of shape (n,)."""

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


@dataclass(frozen=True, slots=True)
class Doubt:
    """A condition that holds at a joint, with the figure that went beyond its bound."""

    condition: Condition
    joint: int
    figures: str


class Plausibility:
    """Compares each tick's complete samples with the bounds, and with those before."""

    def __init__(self, bounds: PlausibilitySettings) -> None:
        n = len(bounds.speed)
        self._b = bounds
        self._middle = 0.5 * (bounds.upper + bounds.lower)
        self._play = 2.0 * GAP_TOLERANCE * bounds.half_gap + bounds.position_margin
        self._bounds = np.stack(
            [
                self._play,  # and what the joint travels in dt
                np.full(n, OVERSPEED_TICKS - 1.0),
                np.full(n, STUCK_TRAVEL),
                np.full(n, bounds.saturated_ticks - 1.0),
                bounds.residual,
                0.5 * (bounds.upper - bounds.lower) + bounds.position_margin,
                self._play
                - 0.5 * bounds.position_margin,  # what repeats to the last bit has no noise
                self._play,
            ]
        )
        self._jump_bound = self._bounds[0]
        self._dt = 0.0
        # Ticks in a row at the current limit, beyond the speed, and with one current.
        self._lasting = np.zeros((3, n))
        self._levels = np.stack([SATURATED_SHARE * bounds.current, bounds.speed, np.ones(n)])
        self._measures = np.zeros_like(self._bounds)
        self._moving = self._measures[:-2]  # what only an energised arm is asked
        self._started = False
        self._theta, self._advance, self._phi, self._scratch = np.zeros((4, n))
        self._lowest, self._highest = np.zeros((2, n))  # of q - theta
        self._values, self._before = np.zeros((2, 2, n))  # q, current: now, and a tick ago
        self._velocity = np.zeros(n)
        self._sizes = np.zeros((3, n))
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
        dt: float,
        energised: bool,
    ) -> tuple[Doubt, ...]:
        """Everything that cannot be true of these samples, dt [s] after those before."""
        values, before = self._values, self._before = self._before, self._values
        values[0], values[1] = q, current
        self._turn(motor_velocity, motor_position, dt)
        if not self._started:
            self._start()
        jump, speed, stuck, saturated, torque, outside, frozen, apart = m = self._measures

        phi = np.subtract(q, self._theta, out=self._phi)
        np.maximum(self._highest, phi, out=self._highest)
        np.minimum(self._lowest, phi, out=self._lowest)
        np.subtract(self._highest, self._lowest, out=apart)

        turned = self._turned
        turned += self._advance
        same = values == before
        turned *= same
        frozen[:], stuck[:] = turned

        if energised:
            sizes, lasting = self._sizes, self._lasting
            sizes[0], sizes[1], sizes[2] = current, motor_velocity, same[1]
            self._velocity[:] = motor_velocity
            np.abs(sizes, out=sizes)
            lasting += 1.0
            lasting *= sizes >= self._levels
            saturated[:], speed[:] = lasting[:2]
            np.subtract(q, before[0], out=jump)
            jump -= self._advance
            torque[:] = residual
            np.subtract(q, self._middle, out=outside)
            if dt != self._dt:
                self._dt = dt
                np.multiply(self._b.speed, dt, out=self._jump_bound)
                self._jump_bound += self._play
        else:
            self._moving.fill(0.0)
            self._lasting.fill(0.0)
            turned[1] = 0.0
        np.abs(m, out=m)
        beyond = m > self._bounds
        return tuple(self._doubts(beyond)) if np.count_nonzero(beyond) else ()

    def _turn(self, motor_velocity: Vector, motor_position: Vector | None, dt: float) -> None:
        """Move theta, and say by how much."""
        if motor_position is not None:
            np.subtract(motor_position, self._theta, out=self._advance)
            self._theta[:] = motor_position
            return
        np.multiply(motor_velocity, dt, out=self._advance)
        np.abs(motor_velocity, out=self._scratch)
        self._advance *= self._scratch > STANDSTILL_SPEED
        self._theta += self._advance
        # An integral drifts: what it was long ago says less and less of where the gap is.
        drift = self._b.motor_drift * dt + self._b.motor_scale_error * np.abs(self._advance)
        self._highest -= drift
        self._lowest += drift

    def _start(self) -> None:
        self._started = True
        q = self._values[0]
        np.subtract(q, self._theta, out=self._lowest)
        self._highest[:] = self._lowest
        self._before[:] = self._values
        self._advance.fill(0.0)
        self._turned.fill(0.0)
        self._lasting.fill(0.0)

    def _doubts(self, beyond: NDArray[np.bool_]) -> Iterator[Doubt]:
        for row, joint in zip(*np.nonzero(beyond), strict=True):
            condition = _ROWS[row]
            if condition is Condition.JOINT_LIMIT and not self._goes_outwards(joint):
                continue
            if condition is Condition.TORQUE_STUCK and self._lasting[2, joint] < STUCK_TICKS:
                continue
            if condition is Condition.OVERSPEED and self._brakes(joint):
                self._lasting[1, joint] = 0.0
                continue
            figure, bound = self._measures[row, joint], self._bounds[row, joint]
            yield Doubt(condition, int(joint), _FIGURES[condition].format(figure, bound))

    def _goes_outwards(self, joint: int) -> bool:
        (q, _), (before, _) = self._values[:, joint], self._before[:, joint]
        side = 1.0 if q > self._middle[joint] else -1.0
        return bool(side * (q - before) > STANDSTILL_SPEED * self._dt)

    def _brakes(self, joint: int) -> bool:
        """Somebody is stronger than the motor, which resists with half its current or more."""
        driving = np.sign(self._velocity[joint]) * self._values[1, joint]
        return bool(driving < -0.5 * self._b.current[joint])
