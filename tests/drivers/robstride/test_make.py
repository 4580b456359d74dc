"""What a configuration of RobStride motors is asked: problems, and the load of the bus."""

from pathlib import Path
from shutil import copytree

import msgspec
import pytest

from bench.rigs.lockstep import BEAM
from common.errors import ConfigurationError
from daemon.config.load import load_robot
from drivers.can.load import bus_load
from drivers.robstride import make

DRIVES = load_robot(BEAM).configuration.joint_drives


@pytest.mark.parametrize(
    ("profile", "wiring", "play", "at", "says"),
    [
        ({"stiffness": 600.0}, {}, 0.0, "stiffness", "500"),
        ({"damping": 6.0}, {}, 0.0, "damping", "5"),
        ({"torque_max_Nm": 170.0}, {}, 0.0, "torque_max_Nm", "17"),
        ({"velocity_max": 440.0}, {}, 0.0, "velocity_max", "44"),
        ({}, {"gear": 9.0}, 0.0, "wiring.gear", "7.75"),
        ({}, {"link_sign": -1}, 0.0, "wiring.link_sign", "motor_sign"),
        ({}, {}, 0.004, "half_gap", "0.002"),
        ({"torque_max_Nm": 10.0}, {}, 0.0, "wiring.max_current_A", "torque_max_Nm"),
    ],
)
def test_problems(profile, wiring, play: float, at: str, says: str) -> None:
    """Those of a profile at its fields, those of a joint at the joint's."""
    one = DRIVES[0]
    changed = msgspec.structs.replace(one.profile, **profile)
    wired = msgspec.structs.replace(one.wiring, **wiring)
    drive = type(one)(one.name, wired, changed, one.velocity, one.quick_stop, play)
    of_profile = make.problems(changed, [drive], Path(), 10, 127)
    ((place, text),) = [*of_profile, *make.wrong(drive)]
    assert bool(of_profile) is (at in profile)
    assert ".".join(map(str, place)) == at
    assert says in text


@pytest.mark.parametrize(
    ("old", "new", "at", "allowed", "others"),
    [
        ("model: RS00", "model: RS09", "drives.RS00.model", "RS00", "DM4310"),
        ("model: RS00", "modell: RS00", "drives.RS00", "stiffness", "tpdo"),
        ("make: robstride, model: RS00", "model: RS00", "drives.RS00", "make: robstride", "DM4310"),
        ("gear: 10,", "gear: 9,", "(joint3).wiring.gear", "RS00 is 10", "drives"),
        ("make: robstride, model: RS00", "make: robot, model: RS00", "RS00.make", "damiao", "eds"),
        (
            "make: robstride, model: RS00",
            "make: damiao, position_max: 12.5, model: DM4310",
            "RS00.make",
            "of one make",
            "tpdo",
        ),
    ],
)
def test_a_wrong_word_names_those_of_its_make(
    tmp_path: Path, old: str, new: str, at: str, allowed: str, others: str
) -> None:
    folder = copytree(BEAM, tmp_path / "arm")
    path = folder / "config.yaml"
    text = path.read_text()
    path.write_text(text.replace(old, new))
    line = text[: text.index(old)].count("\n") + 1
    with pytest.raises(ConfigurationError) as error:
        load_robot(folder)
    said = str(error.value)
    assert f"config.yaml:{line}: " in said
    assert f"{at}: " in said
    assert allowed in said.replace(at, "")
    assert others not in said


def test_the_example_has_none() -> None:
    for name in {drive.wiring.profile for drive in DRIVES}:
        its = [drive for drive in DRIVES if drive.wiring.profile == name]
        assert make.problems(its[0].profile, its, Path(), 10, 127) == []
        assert not [what for drive in its for what in make.wrong(drive)]


def test_seven_joints_take_less_than_a_quarter_of_a_megabit() -> None:
    load = bus_load(make.frames([*DRIVES, DRIVES[0]], 0.01), 1_000_000)
    assert load == pytest.approx(7 * 2 * 100 * 160 / 1e6)
