"""The whole tick around an arm without a bus: faster than lockstep, for hours of armed work.

    with_arm = ArmInTheLoop(subject, robot)

`Harness` moves plant, servo and sensors on; what stands in the place of the drives passes its
samples to the tick and the tick's target velocities back, a period late as on a bus. Boot-up, PDOs
and faults of drives are not shown: for them there is `bench.rigs.lockstep`.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bench.rigs.arm_without_bus import Harness, Subject
from bench.rigs.lockstep import TRUSTED, WALL_S
from common.arrays import Vector
from daemon.assembly import (
    build_controller,
    build_estimator,
    build_fault_detector,
    check_parameters,
)
from daemon.config.load import Robot
from daemon.config.motion import limits_of, row
from daemon.modes.table import Event, Mode
from daemon.tick.arming_checks import ArmingChecks
from daemon.tick.telemetry import Wakeup
from daemon.tick.tick import Tick
from drivers.canopen.answers import Samples
from drivers.canopen.cia402 import DriveState, PowerTarget
from estimator.estimate import Estimate

_OFF, _ENABLED = 0x0250, 0x0237  # statuswords


class IdealDrives:
    """Drives that obey at once, and answer every SYNC in time, but for the samples
    of the joints in `lost`."""

    silenced = False

    def __init__(self, harness: Harness, names: Sequence[str]) -> None:
        self.names, self.nodes = tuple(names), tuple(range(1, len(names) + 1))
        self.external: Vector = np.zeros(len(names))
        """Torque on the links over the next period (n,) [Nm]."""
        self.lost: NDArray[np.bool_] = np.zeros(len(names), dtype=np.bool_)
        """Joints whose samples of the next tick do not arrive (n,)."""
        self._harness = harness
        self._last = harness.sample()
        self._age = np.zeros(len(names), dtype=np.int64)
        self._never = np.zeros(len(names), dtype=np.bool_)
        self._enabled = False

    def sync(self, now: float) -> None:
        """Move the arm on by a period."""
        del now
        torque = np.repeat(self.external[np.newaxis], self._harness.per_tick, axis=0)
        self._harness.period(torque)

    def collect(self, deadline: float) -> Samples:
        """What the drives measured at the SYNC."""
        del deadline
        measured, fresh = self._harness.sample(), ~self.lost
        measured[:, self.lost] = self._last[:, self.lost]
        self._last = measured
        self._age = np.where(fresh, 0, self._age + 1)
        current, position, velocity, motor = measured
        state = DriveState.OPERATION_ENABLED if self._enabled else DriveState.SWITCH_ON_DISABLED
        return Samples(
            current=current,
            link_position=position,
            motor_velocity=velocity,
            motor_position=motor,
            fresh=fresh,
            age_ticks=self._age,
            starting=self._never,
            states=(state,) * len(self.names),
            statuswords=(_ENABLED if self._enabled else _OFF,) * len(self.names),
        )

    def command(
        self,
        power: PowerTarget | Sequence[PowerTarget],
        velocity: Vector,
        reset: bool = False,
        *,
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

    def silent(self) -> tuple[str, ...]:
        """None."""
        return ()

    def restarted(self) -> tuple[str, ...]:
        """None."""
        return ()

    def doubted(self) -> tuple[str, ...]:
        """None."""
        return ()

    def no_sdo(self) -> tuple[str, ...]:
        """None."""
        return ()


class ArmInTheLoop:
    """Tick and arm; `step` moves both on by a period."""

    def __init__(self, subject: Subject, robot: Robot, start: Vector) -> None:
        """Begins at rest at `start` (n,) [rad], with the drives off."""
        c = robot.configuration
        self.robot, self.period_s = robot, c.period_s
        self.harness = Harness(subject)
        self.harness.plant.place(start)
        self.harness.energise()
        self.drives = IdealDrives(self.harness, c.joint_names)
        self.tick = Tick(
            self.drives,  # type: ignore[arg-type]
            build_estimator(c, robot.model),
            build_controller(robot, links_trusted=True),
            build_fault_detector(c),
            ArmingChecks(
                self.drives.names,
                self.drives.nodes,
                limits_of(c),
                c.period_s,
                (TRUSTED, check_parameters(robot)),
                row(c, lambda j: j.thresholds.contact),
            ),
            c.period_s,
        )
        self.ticks = 0

    @property
    def time_s(self) -> float:
        """Time of the next tick [s]."""
        return self.ticks * self.period_s

    @property
    def mode(self) -> Mode:
        """The controller's."""
        return self.tick.controller.machine.mode

    @property
    def estimate(self) -> Estimate:
        """The newest; AssertionError before the first."""
        assert self.tick.last is not None
        assert self.tick.last.estimate is not None
        return self.tick.last.estimate

    def step(self) -> None:
        """One tick."""
        self.tick.begin(self.time_s)
        self.tick.finish(0.0, Wakeup(wall_s=WALL_S + self.time_s))
        self.ticks += 1

    def run(self, seconds: float) -> None:
        """Tick for so long."""
        for _ in range(round(seconds / self.period_s)):
            self.step()

    def start(self) -> None:
        """Enable, and start the trajectory. Raises RuntimeError with the reasons of a refusal."""
        self.run(0.5)
        for event in (Event.ENABLE, Event.START):
            if reasons := self.tick.controller.request(event, "the bench", self.time_s):
                raise RuntimeError("; ".join(reasons))
            self.run(0.5)

    def arm(self) -> list[str]:
        """Arm; returns the reasons of a refusal."""
        reasons = self.tick.check_arming(self.time_s).reasons
        return list(reasons) or self.tick.controller.arm("the bench")
