"""What a configuration of RobStride motors is asked: problems, and the load of the bus."""

from pathlib import Path

import msgspec
import pytest

from bench.rigs.lockstep import BEAM
from daemon.config.load import load_robot
from drivers.can.load import bus_load
from drivers.robstride import make

DRIVES = load_robot(BEAM).configuration.joint_drives


@pytest.mark.parametrize(
    ("profile", "wiring", "play", "at", "says"),
    [
        ({"stiffness": 600.0}, {}, 0.0, "stiffness", "500"),
        ({"damping": 6.0}, {}, 0.0, "damping", "5"),
        ({}, {"gear": 9.0}, 0.0, "model", "7.75"),
        ({}, {"link_sign": -1}, 0.0, "model", "motor_sign"),
        ({}, {}, 0.004, "model", "half_gap 0.002"),
        ({"torque_max_Nm": 10.0}, {}, 0.0, "model", "torque_max_Nm"),
    ],
)
def test_problems(profile, wiring, play: float, at: str, says: str) -> None:
    one = DRIVES[0]
    changed = msgspec.structs.replace(one.profile, **profile)
    wired = msgspec.structs.replace(one.wiring, **wiring)
    drive = type(one)(one.name, wired, changed, one.velocity, one.quick_stop, play)
    ((place, text),) = make.problems(changed, [drive], Path(), 10, 127)
    assert place == (at,)
    assert says in text


def test_the_example_has_none() -> None:
    for name in {drive.wiring.profile for drive in DRIVES}:
        its = [drive for drive in DRIVES if drive.wiring.profile == name]
        assert make.problems(its[0].profile, its, Path(), 10, 127) == []


def test_seven_joints_take_less_than_half_of_a_megabit() -> None:
    load = bus_load(make.frames([*DRIVES, DRIVES[0]], 0.01), 1_000_000)
    assert load == pytest.approx(7 * 4 * 100 * 160 / 1e6)
