"""Plausibility checks on measured samples: encoders, torques, speeds, joint limits. Pure.

Arrays of shape (n,), SI at the link side; time is an argument. `measures` compares all measures
with their bounds; those that exceed them become findings here.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from common.arrays import Vector
from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.faults.measures import Measures

# Largest ratio of a half-gap to its identified value.
GAP_TOLERANCE: Final = 1.1
# A measured current has noise; one that is bit-identical for this many ticks, while the motor turns
# this far [rad], is stuck.
STUCK_TRAVEL: Final = 0.1
STUCK_TICKS: Final = 20
# Share of the current limit at which a drive is at its limit.
SATURATED_SHARE: Final = 0.95
# An impact may drive a motor beyond its speed limit for a tick or two.
OVERSPEED_TICKS: Final = 3

# Speed below which a joint or a motor is at standstill [rad/s]: a few counts of a coarse velocity,
# or its bias, are not motion.
STANDSTILL_SPEED: Final = 0.02
# Rows of the measures in order, with the text for value and bound of each; of several at one joint
# the first is closest to the cause.
_ENERGISED_ONLY: Final = {
    Condition.JUMP: "by {:.3f} rad, at most {:.3f}",
    Condition.OVERSPEED: "for {:.0f} ticks, at most {:.0f}",
    Condition.TORQUE_STUCK: "while the motor turned by {:.3f} rad, at most {:.3f}",
    Condition.TORQUE_SATURATED: "for {:.0f} ticks, at most {:.0f}",
    Condition.RESIDUAL_LIMIT: "{:.1f} Nm, at most {:.1f}",
    Condition.JOINT_LIMIT: "at {q:.3f} rad; {lower:.3f} to {upper:.3f} allowed",
}
# These also apply to an arm that is moved by hand.
_ALWAYS: Final = {
    Condition.FROZEN: "while the motor turned by {:.3f} rad, at most {:.3f}",
    Condition.APART: "by {:.3f} rad, at most {:.3f}",
}
_FIGURES: Final = _ENERGISED_ONLY | _ALWAYS
_ROWS: Final = tuple(_FIGURES)


@dataclass(frozen=True, slots=True)
class PlausibilitySettings:
    """Bounds on the measurements of each joint, arrays of shape (n,)."""

    lower: Vector  # joint limits [rad]
    upper: Vector
    speed: Vector  # of motor and link [rad/s]
    half_gap: Vector  # [rad]
    position_margin: float  # encoder noise, and the gear's deflection [rad]
    current: Vector  # the drives' limit [A]
    residual: Vector  # [Nm]
    saturated_ticks: int
    motor_drift: float  # drift of an integrated motor position [rad/s]
    motor_scale_error: float  # and its error as a share of the speed


class Plausibility:
    """Comparison of the samples of each joint with the bounds, and with earlier samples."""

    def __init__(self, joints: Sequence[str], settings: PlausibilitySettings) -> None:
        self._joints, self._settings = tuple(joints), settings
        n = len(self._joints)
        self._middle = 0.5 * (settings.upper + settings.lower)
        play = 2.0 * GAP_TOLERANCE * settings.half_gap + settings.position_margin
        bound_of = {
            Condition.JUMP: play,  # plus the travel in dt
            Condition.OVERSPEED: np.full(n, OVERSPEED_TICKS - 1.0),
            Condition.TORQUE_STUCK: np.full(n, STUCK_TRAVEL),
            Condition.TORQUE_SATURATED: np.full(n, settings.saturated_ticks - 1.0),
            Condition.RESIDUAL_LIMIT: settings.residual,
            Condition.JOINT_LIMIT: 0.5 * (settings.upper - settings.lower)
            + settings.position_margin,
            # Bit-identical values have no noise.
            Condition.FROZEN: play - 0.5 * settings.position_margin,
            Condition.APART: play,
        }
        self._measured = Measures(
            np.stack([bound_of[condition] for condition in _ROWS]),
            middle=self._middle,
            play=play,
            full_current=SATURATED_SHARE * settings.current,
            speed=settings.speed,
            standstill=STANDSTILL_SPEED,
            motor_drift=settings.motor_drift,
            motor_scale_error=settings.motor_scale_error,
        )

    def restart(self) -> None:
        """Forget earlier samples: the next ones are accepted without comparison."""
        self._measured.restart()

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
        """Findings about implausible samples, taken dt (n,) [s] after the previous ones; where dt
        is 0 they are the previous ones, and are not evidence."""
        beyond = self._measured.step(
            q, motor_velocity, motor_position, current, residual, dt, energised
        )
        return tuple(self._findings()) if beyond else ()

    def _findings(self) -> Iterator[Finding]:
        measured = self._measured
        measures, bounds = np.asarray(measured.measures), np.asarray(measured.bounds)
        for row, joint in zip(*np.nonzero(measures > bounds), strict=True):
            condition = _ROWS[row]
            if condition is Condition.JOINT_LIMIT and not self._goes_outwards(joint):
                continue
            if condition is Condition.TORQUE_STUCK and measured.same_ticks[joint] < STUCK_TICKS:
                continue
            if condition is Condition.OVERSPEED and self._brakes(joint):
                measured.fast_ticks[joint] = 0.0
                continue
            figure, bound = measures[row, joint], bounds[row, joint]
            upper, lower = self._middle[joint] + bound, self._middle[joint] - bound
            text = _FIGURES[condition].format(
                figure, bound, q=measured.q[joint], lower=lower, upper=upper
            )
            yield Finding(condition, self._joints[joint], text)

    def _goes_outwards(self, joint: int) -> bool:
        measured = self._measured
        q, before = measured.q[joint], measured.q_before[joint]
        side = 1.0 if q > self._middle[joint] else -1.0
        return bool(side * (q - before) > STANDSTILL_SPEED * measured.dt[joint])

    def _brakes(self, joint: int) -> bool:
        """True if an external push overcomes the motor, which resists with half its current or
        more."""
        measured = self._measured
        driving = np.sign(measured.velocity[joint]) * measured.current[joint]
        return bool(driving < -0.5 * self._settings.current[joint])
