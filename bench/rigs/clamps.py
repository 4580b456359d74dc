"""Clamp of a joint: what a link presses against, and what a person behind it holds against it.

Stands in the place of the simulated arm's hand: `rig.arm.hand = cast(Hand, Clamps(rig))`. Each
obstacle pushes one way only, as a thing does that nothing is stuck to.
"""

from dataclasses import dataclass
from typing import cast

from arrays import Vector
from bench.rigs.lockstep import Rig
from simulator.hand import Hand

# Damping ratio of an obstacle with the lightest link that may meet it: soft wood, a forearm.
DAMPING_RATIO = 0.2


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A spring in the way of one joint, on the side at which its position is above `place`
    (side 1) or below it (side -1)."""

    joint: int
    place: float  # [rad]
    side: int
    stiffness: float  # [Nm/rad]
    damping: float  # [Nm s/rad]

    def torque(self, q: float, q_dot: float) -> float:
        """Torque on the link [Nm]: away from the obstacle, or none."""
        depth = self.side * (q - self.place)
        if depth <= 0.0:
            return 0.0
        push = self.stiffness * depth + self.damping * self.side * q_dot
        return -self.side * max(push, 0.0)


class Clamps:
    """Everything that is in the way of one simulated arm."""

    began, touching, done, busy = True, True, False, True

    def __init__(self, rig: Rig) -> None:
        """Take the place of the arm's hand."""
        self._arm = rig.arm
        self.obstacles: list[Obstacle] = []
        self.trace: list[tuple[float, list[float]]] = []
        """Time [s] and torque of each obstacle [Nm], every millisecond since there is one."""
        rig.arm.hand = cast(Hand, self)  # all of it that is used

    def put(self, joint: int, distance: float, side: int, stiffness: float) -> Obstacle:
        """Put an obstacle `distance` [rad] before a link that moves to `side`; returns it."""
        parameters = self._arm.plant.parameters
        # Beyond what the plant's step resolves a damper would shake by itself.
        mass = float(parameters.lightest_link[joint])
        damping = min(
            2.0 * DAMPING_RATIO * (stiffness * mass) ** 0.5,
            0.3 * mass / self._arm.settings.step_s,
        )
        place = float(self._arm.plant.q[joint]) + side * distance
        obstacle = Obstacle(joint, place, side, stiffness, damping)
        self.obstacles.append(obstacle)
        return obstacle

    def felt(self, obstacle: Obstacle) -> float:
        """True torque of an obstacle now, away from it and so never negative [Nm]."""
        i, plant = obstacle.joint, self._arm.plant
        return -obstacle.side * obstacle.torque(float(plant.q[i]), float(plant.q_dot[i]))

    # --- as the arm's hand ----------------------------------------------------------------------

    def update(self, t: float, q: Vector, period_s: float = 0.001) -> list[str]:
        """Once per millisecond."""
        if self.obstacles:
            self.trace.append((t, [self.felt(each) for each in self.obstacles]))
        return []

    def torque(self, q: Vector, q_dot: Vector, out: Vector) -> None:
        """Add the torque of all obstacles to out (n,) [Nm]."""
        for obstacle in self.obstacles:
            i = obstacle.joint
            out[i] += obstacle.torque(float(q[i]), float(q_dot[i]))
