"""Travel after a fault as `contactd check` prints it, against a simulated plant."""

import re

import can
import numpy as np
import pytest

from bench.rigs.lockstep import ROMEO, SINGLE_JOINT, Rig, lockstep_rig
from daemon.config.load import load_robot
from drivers.api import PowerTarget
from drivers.stopping.travel import worst_travel
from programs.contactd.check import print_check
from programs.contactd.travels import detection_ticks, travels

MASTERS_HEARTBEAT = 0x77F


@pytest.mark.parametrize("folder", [ROMEO, ROMEO.parent / "desk_arm", SINGLE_JOINT])
def test_a_drive_that_ignores_commands_travels_at_most_twice_as_far_as_without_a_daemon(
    folder,
) -> None:
    c = load_robot(folder).configuration
    for travel in travels(c):
        dies = travel.master_timeout + travel.braking
        assert travel.total - travel.detection <= 2.0 * dies


def test_no_joint_travels_further_than_computed_when_the_daemon_dies_at_full_speed() -> None:
    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.enable()
        c = rig.robot.configuration
        joint, arm, plant = c.joints[0], rig.drives, rig.arm.plant
        heard = 0.0

        def note(message: can.Message, receive=rig.arm.receive) -> None:
            nonlocal heard
            receive(message)
            if message.arbitration_id == MASTERS_HEARTBEAT:
                heard = float(plant.q[0])

        rig.arm.receive = note  # type: ignore[method-assign]
        for _ in range(45):
            arm.sync(rig.time_s)
            rig.lockstep.pump()
            arm.collect(0.0)
            arm.command(PowerTarget.ON, np.array([joint.limits.velocity]))
            rig.ticks += 1
        assert abs(plant.q_dot[0]) > 0.95 * joint.limits.velocity
        rig.arm.advance(rig.arm.now + 1.0)  # nothing is sent any more
        assert abs(plant.q_dot[0]) < 1e-3
        travelled = float(plant.q[0]) - heard
        (travel,) = worst_travel(c.joint_drives, c.period_s, 0.0)
        worst = travel.master_timeout + travel.braking
        assert 0.8 * worst < travelled <= worst


def at_full_speed(rig: Rig, power: PowerTarget, velocity: float) -> None:
    """One tick of the drives alone, without the daemon's decisions."""
    drives = rig.drives
    drives.sync(rig.time_s)
    syncs = rig.lockstep.syncs
    rig.lockstep.pump()
    if rig.lockstep.syncs == syncs:
        rig.arm.advance(rig.arm.now + rig.robot.configuration.period_s)
        rig.lockstep.pump()
    drives.collect(0.0)
    drives.command(power, np.array([velocity]))
    rig.ticks += 1


@pytest.mark.parametrize("shows", [True, False])
@pytest.mark.parametrize(
    "obeys",
    [
        ("on_pdo", "on_sdo", "on_nmt", "on_heartbeat"),
        ("on_sdo", "on_nmt", "on_heartbeat"),
        ("on_nmt", "on_heartbeat"),
        ("on_heartbeat",),
    ],
)
def test_no_joint_travels_further_than_computed_whatever_its_drive_obeys(
    obeys: tuple[str, ...], shows: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A drive that ignores more and more messages at full speed, and reports its motion or not.
    The travel is its motor's: the link swings on in its gap."""
    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.enable()
        c, drive, plant = rig.robot.configuration, rig.arm.drives[0], rig.arm.plant
        velocity = c.joints[0].limits.velocity
        for _ in range(30):
            at_full_speed(rig, PowerTarget.ON, velocity)
        assert plant.theta_dot[0] > 0.95 * velocity
        ignored = {"on_pdo", "on_sdo", "on_nmt"} - set(obeys)
        for method in (*ignored, *([] if shows else ["transmit"])):
            monkeypatch.setattr(drive, method, lambda *_: None)
        began = float(plant.theta[0])
        for _ in range(detection_ticks(c)):
            at_full_speed(rig, PowerTarget.ON, velocity)
        for _ in range(60):
            at_full_speed(rig, PowerTarget.QUICK_STOP, 0.0)
        assert abs(plant.theta_dot[0]) < 0.02
        (travel,) = travels(c)
        assert float(plant.theta[0]) - began <= travel.total
        drives = rig.drives
        assert drives.silenced is ("on_sdo" not in obeys), "nothing else can say so after that"
        assert drives.silenced or not drives.unproved()


def test_check_prints_it(capsys) -> None:
    print_check(ROMEO)
    printed = capsys.readouterr().out
    begin = printed.index("travel, at worst, from a fault at full speed until the joint stands\n")
    assert [" ".join(line.split()) for line in printed[begin:].splitlines()[1:4]] == [
        "until in the master quick too daemon",
        "speed braking found stops missed stop in all fast dies",
        "joint rad/s rad/s2 rad rad rad rad rad rad rad",
    ]
    row = next(line for line in printed.splitlines() if re.match(r"LElbowRoll +1\.2 ", line))
    figures = ["1.2", "12", "0.336", "0.108", "0.120", "0.060", "0.624", "0.984", "0.180"]
    assert row.split()[1:] == figures
