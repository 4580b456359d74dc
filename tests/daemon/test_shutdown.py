"""End of the program: from every mode to an arm at rest, each joint as configured."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Literal

import msgspec
import pytest

from bench.rigs.lockstep import SINGLE_JOINT, Rig, lockstep_rig
from bench.rigs.served_daemon import ServedDaemon
from daemon.config.schema import Configuration
from daemon.modes.table import Event, Mode
from daemon.protocol.requests import AT_THE_END, COMMANDS, Command, Follow, SetGain, Target, bare
from daemon.shutdown import bring_to_rest
from daemon.tick.loop import Clock, Loop
from programs.clients.client import Client
from simulator.state_machine import State

End = Literal["hold", "brake", "limp"]
WHY = "SIGTERM"


@dataclass(slots=True)
class Wound:
    """A loop on a clock that only waiting moves, over drives that answer every SYNC."""

    rig: Rig
    now_s: float = 0.0
    loop: Loop = field(init=False)

    def __post_init__(self) -> None:
        begin = self.rig.tick.begin

        def answered(time_s: float) -> None:
            begin(time_s)
            self.rig.lockstep.pump()

        self.rig.tick.begin = answered  # type: ignore[method-assign]
        period_s = self.rig.robot.configuration.period_s
        self.loop = Loop(self.rig.tick, Clock(lambda: self.now_s, self.wait, lambda: 0.0), period_s)

    def wait(self, until_s: float) -> None:
        self.now_s = max(self.now_s, until_s)

    def run(self, seconds: float) -> None:
        end = self.now_s + seconds
        self.loop.run(lambda: None, lambda: self.now_s < end)

    def request(self, event: Event) -> None:
        assert self.rig.tick.controller.request(event, "the test", self.loop.time_s) == []

    def bring_to(self, mode: Mode) -> None:
        self.run(0.2)
        if mode is Mode.OFF:
            return
        self.request(Event.ENABLE)
        if mode is Mode.ENABLING:
            return
        self.run(0.5)
        if mode is not Mode.HOLDING:
            self.request(Event.START)
            self.run(1.5)
        if mode is Mode.ADMITTANCE:
            assert self.rig.arming.run(self.loop.time_s).reasons == ()
            assert self.rig.tick.controller.arm("the test") == []
            self.rig.arm.external_torque[0] = 3.0
            self.run(0.3)
            self.rig.arm.external_torque[0] = 0.0
        elif mode is Mode.STOPPING:
            self.request(Event.STOP)
        elif mode is Mode.FAULTED:
            self.rig.arm.drives[0].fault(0x8611, "the test")
            self.run(0.1)

    def bring_to_rest(self) -> list[str]:
        timeout_s = self.rig.robot.configuration.supervisor.stop_timeout_s
        return bring_to_rest(self.loop, lambda: None, timeout_s, WHY)

    @property
    def drive(self) -> State:
        return self.rig.arm.drives[0].state


@contextmanager
def wound(mode: Mode, end: End) -> Iterator[Wound]:
    def configure(c: Configuration) -> Configuration:
        joints = [msgspec.structs.replace(joint, end=end) for joint in c.joints]
        return msgspec.structs.replace(c, joints=joints)

    with lockstep_rig(SINGLE_JOINT, configure=configure) as rig:
        brought = Wound(rig)
        brought.bring_to(mode)
        assert rig.mode is mode
        yield brought


ENDS: dict[End, State] = {
    "hold": State.QUICK_STOP_ACTIVE,
    "brake": State.SWITCH_ON_DISABLED,
    "limp": State.SWITCH_ON_DISABLED,
}


@pytest.mark.parametrize("end", list(ENDS))
@pytest.mark.parametrize("mode", [Mode.HOLDING, Mode.TRACKING, Mode.ADMITTANCE, Mode.STOPPING])
def test_an_energised_arm_ends_as_configured(mode: Mode, end: End) -> None:
    with wound(mode, end) as arm:
        assert arm.drive is State.OPERATION_ENABLED
        assert arm.bring_to_rest() == []
        assert arm.drive is ENDS[end]
        assert arm.rig.mode is Mode.OFF
        # Without a brake of its own the joint begins to sag then, as it is meant to.
        assert abs(arm.rig.arm.plant.theta_dot[0]) < (0.02 if end == "hold" else 0.1)


@pytest.mark.parametrize("ticks", range(1, 6))
def test_a_drive_on_its_way_up_is_not_at_its_end(ticks: int) -> None:
    with wound(Mode.ENABLING, "brake") as arm:
        arm.run(0.01 * ticks - 0.005)
        assert arm.bring_to_rest() == []
        assert arm.drive in (State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON)
        arm.run(0.1)
        assert arm.drive in (State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON)


def test_what_is_off_stays_off() -> None:
    with wound(Mode.OFF, "hold") as arm:
        ticks = arm.rig.tick.number
        assert arm.bring_to_rest() == []
        assert arm.drive is State.SWITCH_ON_DISABLED
        assert arm.rig.tick.number - ticks <= 2


def test_a_faulted_arm_stays_faulted() -> None:
    with wound(Mode.FAULTED, "hold") as arm:
        assert arm.bring_to_rest() == []
        assert arm.rig.mode is Mode.FAULTED


@pytest.mark.parametrize(("deaf_to_sdo", "named"), [(False, []), (True, ["joint"])])
def test_a_drive_that_does_not_obey_is_commanded_by_sdo_and_else_named(
    deaf_to_sdo: bool, named: list[str]
) -> None:
    with wound(Mode.HOLDING, "brake") as arm:
        listen, drive = arm.rig.arm.receive, arm.rig.arm.drives[0]
        deaf = {pdo.cob_id for pdo in drive.pdos.received}
        deaf |= {0x600 + drive.node} if deaf_to_sdo else set()
        arm.rig.arm.receive = lambda m: None if m.arbitration_id in deaf else listen(m)  # type: ignore[method-assign]
        assert arm.bring_to_rest() == named


# What `load` and `start` take is beside the point.
REQUIRED = {
    "gain": SetGain(joint="joint", gain=0.1),
    "follow": Follow(q=[0.0], sent_s=0.0),
    "target": Target(q=[0.0], sent_s=0.0, number=1),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_at_the_end_no_client_energises_or_moves_the_arm(
    served: ServedDaemon, command: Command
) -> None:
    served.service.commands.ending = True
    with Client(served.path) as client:
        request = REQUIRED.get(command) or bare(command)
        reply = served.until(lambda: client.ask(request))
    assert reply.ok == (command in AT_THE_END)
    assert reply.reasons == ([] if reply.ok else ["the daemon is ending"])
    assert served.rig.mode is Mode.OFF
