"""Travel after the daemon's death as `contactd check` prints it, against a simulated plant."""

import can
import numpy as np

from bench.rigs.lockstep import ROMEO, SINGLE_JOINT, lockstep_rig
from daemon.commands.check import print_check
from daemon.commands.worst_case import worst_travel
from daemon.config.load import load_robot
from drivers.cia402 import PowerTarget

MASTERS_HEARTBEAT = 0x77F


def test_the_travel_of_a_joint() -> None:
    c = load_robot(ROMEO).configuration
    travel = worst_travel(c.joints[0], c.drives["two_encoder_drive"])
    assert travel.unaware == 0.1  # 1 rad/s for 100 ms
    assert travel.braking == 0.05  # 1 / (2 * 10)
    assert travel.total == travel.unaware + travel.braking


def test_no_joint_goes_further_when_the_daemon_dies_at_full_speed() -> None:
    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.enable()
        joint = rig.robot.configuration.joints[0]
        profile = rig.robot.configuration.drives[joint.wiring.profile]
        arm, plant = rig.tick.drives, rig.arm.plant
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
        rig.arm.advance(rig.arm.now + 1.0)  # nobody sends anything any more
        assert abs(plant.q_dot[0]) < 1e-3
        travelled = float(plant.q[0]) - heard
        worst = worst_travel(joint, profile).total
        assert 0.8 * worst < travelled <= worst


def test_check_prints_it(capsys) -> None:
    print_check(ROMEO)
    printed = capsys.readouterr().out
    assert "travel at worst, if the daemon dies at full speed" in printed
    assert "LElbowRoll      1.2    100          12      0.120        0.060        0.180" in printed
