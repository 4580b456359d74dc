"""The whole tick around an arm without a bus: faster than lockstep, for hours of armed work.

    with_arm = ArmInTheLoop(subject, robot)

`Harness` moves plant, servo and sensors on; what stands in the place of the drives passes its
samples to the tick and the tick's target velocities back, a period late as on a bus. Boot-up, PDOs
and faults of drives are not shown: for them there is `bench.rigs.lockstep`.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from bench.rigs.arm_without_bus import Harness, Subject
from bench.rigs.lockstep import TRUSTED, WALL_S, Ticking
from common.arrays import Vector
from daemon.assembly import build_arming_checks, build_tick
from daemon.config.load import Robot
from daemon.modes.table import Event
from daemon.motion.path import JointPath
from daemon.tick.telemetry import Wakeup
from drivers.api import DriveCondition, DriveStatus, Objection, PowerTarget, Samples

_OFF = DriveStatus(DriveCondition.OFF, "switch on disabled", "off", supplied=True, following=False)
_ENABLED = DriveStatus(
    DriveCondition.OPERATING, "operation enabled", "on", supplied=True, following=False
)


class IdealDrives:
    """Drives that obey at once and answer every SYNC, but for the joints in `lost`."""

    silenced = False

    def __init__(self, harness: Harness, names: Sequence[str], period_s: float) -> None:
        self.names = tuple(names)
        self.external: Vector = np.zeros(len(names))  # On the links over the next period (n,) [Nm]
        self.lost: NDArray[np.bool_] = np.zeros(len(names), dtype=np.bool_)
        """Joints whose samples of the next tick do not arrive (n,)."""
        self.hold: Callable[[Vector, Vector], Vector] | None = None
        """Torque (n,) [Nm] on the links at q, q_dot (n,), beside `external`, each millisecond."""
        self._harness = harness
        self._last = harness.sample()
        self._period_s, self._age = period_s, np.zeros(len(names), dtype=np.int64)
        self._never = np.zeros(len(names), dtype=np.bool_)
        self._enabled = False

    def sync(self, now: float) -> None:
        """Move the arm on by a period."""
        del now
        held, harness = self.hold, self._harness
        if held is None:
            harness.period(np.repeat(self.external[np.newaxis], harness.per_tick, axis=0))
            return
        for _ in range(harness.per_tick):
            harness.period((self.external + held(harness.plant.q, harness.plant.q_dot))[np.newaxis])

    def collect(self, deadline: float) -> Samples:
        """Measurements of the drives at the SYNC."""
        del deadline
        measured, fresh = self._harness.sample(), ~self.lost
        measured[:, self.lost] = self._last[:, self.lost]
        self._last = measured
        self._age = np.where(fresh, 0, self._age + 1)
        current, position, velocity, motor = measured
        return Samples(
            current=current,
            link_position=position,
            motor_velocity=velocity,
            motor_position=motor,
            fresh=fresh,
            age_s=np.multiply(self._age, self._period_s),
            starting=self._never,
            drives=(_ENABLED if self._enabled else _OFF,) * len(self.names),
        )

    def command(
        self,
        power: PowerTarget | Sequence[PowerTarget],
        velocity: Vector,
        reset: bool = False,
        ask: bool = False,
    ) -> None:
        """Follow these target velocities (n,) [rad/s] from the next SYNC on."""
        del reset, ask
        self._enabled = power is PowerTarget.ON or (
            not isinstance(power, PowerTarget) and PowerTarget.ON in power
        )
        self._harness.follow(velocity)

    def unproved(self) -> tuple[str, ...]:
        """None."""
        return ()

    def objections(self) -> tuple[Objection, ...]:
        """None."""
        return ()


class ArmInTheLoop(Ticking):
    """Tick and arm; `step` moves both on by a period."""

    def __init__(self, subject: Subject, robot: Robot, start: Vector) -> None:
        """Begins at rest at `start` (n,) [rad], with the drives off."""
        c = robot.configuration
        self.robot, self.period_s, self.subject = robot, c.period_s, subject
        self.harness = Harness(subject)
        self.harness.plant.place(start)
        self.harness.energise()
        self.drives = IdealDrives(self.harness, c.joint_names, c.period_s)
        self.tick = build_tick(robot, self.drives, TRUSTED)
        self.arming = build_arming_checks(robot, self.tick, TRUSTED)
        self.ticks = 0

    def step(self) -> None:
        """One tick."""
        self.tick.begin(self.time_s)
        self.tick.finish(0.0, Wakeup(wall_s=WALL_S + self.time_s))
        self.ticks += 1

    def start(self) -> None:
        """Enable, and start the trajectory, as `request`."""
        self.run(0.5)
        for event in (Event.ENABLE, Event.START):
            self.request(event)
            self.run(0.5)

    def request(self, event: Event, path: JointPath | None = None) -> None:
        """Request an event. Raises RuntimeError with the reasons of a refusal."""
        if reasons := self.tick.controller.request(event, "the bench", self.time_s, path):
            raise RuntimeError("; ".join(reasons))
