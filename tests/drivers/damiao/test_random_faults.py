"""Random faults of the arm of configs/openarm_left: motors, frames, daemon, hand and requests."""

from contextlib import suppress
from random import Random
from typing import Any

import pytest

from bench.rigs.lockstep import OPENARM, Rig, lockstep_rig
from common.errors import ContactdError
from daemon.modes.table import Event, Mode
from drivers.can.wire import Wire
from drivers.damiao.frames import ENABLE, Status, setpoint_of
from tests.drivers.damiao.test_arm import Filter

T, SECONDS = 0.01, 15.0
WITHOUT_POWER = (Mode.OFF, Mode.FAULTED)


class Run:
    """One arm, whose luck is drawn by a seed."""

    def __init__(self, rig: Rig, wire: Filter, rng: Random) -> None:
        self.rig, self.wire, self.rng = rig, wire, rng
        self.acts: list[Any] = [
            self.silence, self.restart, self.fail, self.hold_up, self.chatter, self.push,
            lambda: self.request(Event.STOP), lambda: self.request(Event.START),
            lambda: self.request(Event.DISABLE), lambda: self.ask(Event.ENABLE),
            lambda: self.ask(Event.RESET),
        ]  # fmt: skip

    def silence(self) -> None:
        motor = self.rng.choice(self.rig.arm.motors)
        motor.silent = not motor.silent

    def restart(self) -> None:
        self.rng.choice(self.rig.arm.motors).boot()

    def fail(self) -> None:
        self.rng.choice(self.rig.arm.motors).fail(self.rng.choice((8, 10, 13, 14)))

    def hold_up(self) -> None:
        """The daemon does nothing for a while."""
        ticks = self.rng.choice((5, 15, 50))
        for _ in range(ticks):
            self.rig.arm.advance(self.rig.arm.now + T)
            self.rig.guard()
            self.rig.lockstep.pump()
        self.rig.ticks += ticks

    def chatter(self) -> None:
        data = bytes(self.rng.randrange(256) for _ in range(self.rng.randrange(9)))
        self.wire.more.append((self.rng.randrange(0x7FF), data))

    def push(self) -> None:
        self.rig.arm.external_torque[:] = 0.0
        self.rig.arm.external_torque[self.rng.randrange(7)] = self.rng.uniform(-4.0, 4.0)

    def request(self, event: Event) -> None:
        self.rig.tick.controller.request(event, "the test", self.rig.time_s)

    def ask(self, event: Event) -> None:
        for motor in self.rig.arm.motors:
            motor.silent = False
        with suppress(ContactdError):
            self.rig.ask(event)


@pytest.mark.parametrize("seed", range(4))
def test_no_fault_moves_or_enables_a_motor(seed: int) -> None:
    rng, filters = Random(seed), []

    def between(wire: Wire) -> Wire:
        filters.append(Filter(wire))
        return filters[0]

    with lockstep_rig(OPENARM, between=between) as rig:
        drives, wire = rig.robot.configuration.joint_drives, filters[0]
        most = [d.wiring.max_current_A * d.profile.Nm_per_A / d.profile.stiffness for d in drives]
        loss = rng.choice((0.0, 0.01, 0.1))
        run = Run(rig, wire, rng)
        rig.enable()
        rig.request(Event.START)
        for _ in range(round(SECONDS / T)):
            if rng.random() < 0.01:
                rng.choice(run.acts)()
            wire.passes = lambda can_id, data: rng.random() >= loss
            rig.step()
            for can_id, data in wire.sent:
                assert data != ENABLE or rig.mode not in WITHOUT_POWER
                found = setpoint_of(data) if can_id <= len(drives) else None
                motor = rig.arm.motors[can_id - 1] if found else None
                if found and motor and motor.status == Status.ENABLED:
                    step = 2.0 * drives[can_id - 1].profile.position_max / 0xFFFF
                    position = (found[0] - 0x7FFF) * step
                    # What it may give, and the way of a motor that is not heard meanwhile.
                    assert abs(position - motor.positions[0]) < most[can_id - 1] + 0.3
