"""Physical bounds: values with which the arm would not detect contact are refused, all of them."""

import re
import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.rigs.lockstep import DESK_ARM, ROMEO, SINGLE_JOINT
from common.errors import ConfigurationError
from daemon.assembly import build_estimator
from daemon.config.bounds import beyond, bounded, near
from daemon.config.load import load_robot
from daemon.config.schema import Configuration, Joint
from daemon.faults.detector import tolerated_ticks
from estimator.estimate import SENSED_PERIODS
from estimator.interval import ROW
from estimator.residual import Residual
from estimator.settings import Variant
from estimator.transmission import stiction_range

ELBOW = r"(?s)(<link name=.LElbowRollLink.>\s*)<inertial>.*?</inertial>"
OF_MOTOR = "Nm (torque_constant times max_current_A)"
# An arm, the file that is edited (a pattern, what takes its place), the place that must be named,
# and what the message must say: value, what is allowed, and by what.
NOT_SENSING: dict[str, tuple[Path, str, str, str, str, tuple[str, ...]]] = {
    "levels of 800 Nm on a motor of 12": (
        SINGLE_JOINT, "config.yaml", "contact: 0.5, collision: 4.0, least: 0.1",
        "contact: 800, collision: 900, least: 160", "joints[0] (joint).thresholds.contact",
        ("800 Nm is outside", "0.012 to 6 Nm", f"0.5 of the motor's 12 {OF_MOTOR}"),
    ),
    "levels below all noise": (
        SINGLE_JOINT, "config.yaml", "contact: 0.5, collision: 4.0, least: 0.1",
        "contact: 1e-12, collision: 4.0, least: 2e-13", "joints[0] (joint).thresholds.contact",
        ("1e-12 Nm is outside", "its noise would be detected"),
    ),
    "one link in grams": (
        ROMEO, "arm.urdf", 'mass value="0.694[0-9]*"', 'mass value="694"',
        "urdf (arm.urdf), line 20",
        ("694 kg is outside", "30 times all other moving links together: is it in kg?"),
    ),
    "a collision that no gear stands": (
        SINGLE_JOINT, "config.yaml", "collision: 4.0", "collision: 36.1",
        "joints[0] (joint).thresholds.collision",
        ("36.1 Nm is outside", "up to 36 Nm", "3 times the motor's 12 Nm"),
    ),
    "a residual that never rises": (
        SINGLE_JOINT, "config.yaml", "estimator:\n", "estimator:\n  gain: 1e-300\n",
        "estimator.gain",
        ("1e-300 /s is outside", "from 4.951 on /s", "ln 2 / gain and a period = 0.15 s"),
    ),
    "a touch that must last too long": (
        SINGLE_JOINT, "config.yaml", "estimator:\n", "estimator:\n  debounce: 14\n",
        "estimator.debounce", ("14 ticks is outside", "up to 12.23 ticks", "ln 2 / gain"),
    ),
    "levels that grow with speed": (
        SINGLE_JOINT, "config.yaml", "least: 0.1}", "least: 0.1, per_speed: 1e6}",
        "joints[0] (joint).thresholds.per_speed",
        ("1e+06 Nm s/rad is outside", "up to 2.75", "level at limits.velocity is 6 Nm"),
    ),
    "no <inertial>": (
        ROMEO, "arm.urdf", ELBOW, r"\1", "urdf (arm.urdf), line 52",
        ("'LElbowRollLink', which joint LElbowRoll moves, has no mass", "needs an <inertial>"),
    ),
    "a mass of zero": (
        ROMEO, "arm.urdf", 'value="0.39848"', 'value="0"', "urdf (arm.urdf), line 52",
        ("'LElbowRollLink', which joint LElbowRoll moves, has no mass",),
    ),
    "an inertia of zero": (
        SINGLE_JOINT, "arm.urdf", r'(i(xx|yy|zz)=)"[^"]*"', r'\1"0"', "urdf (arm.urdf), line 13",
        ("'bar', which joint joint moves, has no inertia about its centre of mass",),
    ),
    "inertias 1e7 too large": (
        SINGLE_JOINT, "arm.urdf", r'(i(?:xx|yy|zz)=)"([^"]*)"', r'\1"\2e7"',
        "urdf (arm.urdf), line 13: link 'bar'",
        ("1.35e+05 kg m2 is outside", "up to 0.0625 kg m2", "1 kg at half the reach", "(0.5 m)"),
    ),
    "masses 1e7 too large": (
        SINGLE_JOINT, "arm.urdf", 'mass value="1.0"', 'mass value="1.0e7"',
        "urdf (arm.urdf), joint joint: gravity at worst",
        ("1.933e+07 Nm is outside", "up to 24 Nm", "are masses in kg"),
    ),
    "masses 1e4 too large on an upright joint": (
        DESK_ARM, "arm.urdf", '(?s)mass value="1.2".*?izz="0.0020"',
        'mass value="12000"/><inertia ixx="60" ixy="0" ixz="0" iyy="60" iyz="0" izz="20"',
        "urdf (arm.urdf), joint column: inertia of 20.04 kg m2 at limits.acceleration (4 rad/s2)",
        ("80.14 Nm is outside", "up to 18 Nm", "2 times the motor's 9 Nm"),
    ),
    "a gap of 0.5 rad": (
        SINGLE_JOINT, "config.yaml", "half_gap: 0.1", "half_gap: 0.5",
        "joints[0] (joint).half_gap",
        ("0.5 rad is outside", "up to 0.175 rad", "0.125 of its range of 2.8 rad"),
    ),
    "friction at rest": (
        SINGLE_JOINT, "config.yaml", "motor_coulomb: 0.3", "motor_coulomb: 1e6",
        "joints[0] (joint).friction.motor_coulomb", ("1e+06 Nm is outside", "up to 6 Nm"),
    ),
    "friction in motion": (
        SINGLE_JOINT, "config.yaml", "link_viscous: 0.02", "link_viscous: 1e6",
        "joints[0] (joint).friction.link_viscous", ("1e+06 Nm s/rad is outside", "up to 3"),
    ),
    "friction that raises the level at rest": (
        SINGLE_JOINT, "config.yaml", "motor_coulomb: 0.3, motor_viscous: 0.2, link_coulomb: 0.03",
        "stiction: 1, motor_coulomb: 5, motor_viscous: 0.2, link_coulomb: 5",
        "joints[0] (joint).thresholds",
        ("19.62 Nm at rest is outside", "up to 12 Nm", "friction (1.9 of 10 Nm: "),
    ),
    "a rotor": (
        SINGLE_JOINT, "config.yaml", "rotor_inertia: 0.04", "rotor_inertia: 1e6",
        "joints[0] (joint).rotor_inertia",
        ("1e+06 kg m2 is outside", "up to 1 kg m2", "at limits.acceleration"),
    ),
    "a spring in the gap": (
        SINGLE_JOINT, "config.yaml", "half_gap: 0.1",
        "half_gap: 0.1\n    gap_spring: {stiffness: 1e6}",
        "joints[0] (joint).gap_spring.stiffness",
        ("1e+06 Nm/rad is outside", "up to 2400", "bends the gear by 0.005 rad"),
    ),
    "a damper in the gap": (
        SINGLE_JOINT, "config.yaml", "half_gap: 0.1",
        "half_gap: 0.1\n    gap_spring: {damping: 1e6}",
        "joints[0] (joint).gap_spring.damping", ("1e+06 Nm s/rad is outside", "up to 3 Nm"),
    ),
    "a motor that makes room for any level": (
        SINGLE_JOINT, "config.yaml", "torque_constant: 3.0", "torque_constant: 300",
        "joints[0] (joint).torque_constant",
        ("300 Nm/A is outside", "up to 61.31", "50 times the weight of the whole arm"),
    ),
    "no motor's torque constant": (
        SINGLE_JOINT, "config.yaml", "torque_constant: 3.0", "torque_constant: 1e-9",
        "joints[0] (joint).torque_constant",
        ("1e-09 Nm/A is outside", "0.01 to 1000 Nm/A", "behind a gear of 100"),
    ),
}  # fmt: skip


def edited(tmp_path: Path, folder: Path, file: str, pattern: str, new: str) -> Path:
    """A copy of a shipped arm with the pattern replaced in one file."""
    for name in ("romeo_left_arm", folder.name):
        shutil.copytree(ROMEO.parent / name, tmp_path / name, dirs_exist_ok=True)
    path = tmp_path / folder.name / file
    text, count = re.subn(pattern, new, path.read_text())
    assert count > 0
    path.write_text(text)
    return tmp_path / folder.name


@pytest.mark.parametrize("name", NOT_SENSING)
def test_a_value_with_which_contact_is_not_detected_is_refused(name: str, tmp_path: Path) -> None:
    folder, file, pattern, new, where, words = NOT_SENSING[name]
    arm = edited(tmp_path, folder, file, pattern, new)
    with pytest.raises(ConfigurationError) as caught:
        load_robot(arm)
    lines = [line for line in str(caught.value).splitlines() if f": {where}: " in line]
    assert lines, caught.value
    for word in words:
        assert any(word in line for line in lines), (word, lines)
    number = int(lines[0].removeprefix(f"{arm / 'config.yaml'}:").partition(":")[0])
    line = (arm / "config.yaml").read_text().splitlines()[number - 1]
    assert ("urdf:" if file == "arm.urdf" else where.rpartition(".")[2]) in line


@pytest.mark.parametrize("folder", [ROMEO, DESK_ARM, SINGLE_JOINT])
def test_every_shipped_arm_is_well_within(folder: Path) -> None:
    robot = load_robot(folder)
    assert near(robot.configuration, robot.model) == []
    assert all(not one.refused for one in bounded(robot.configuration, robot.model))


def test_a_frame_needs_no_inertial(tmp_path: Path) -> None:
    tool = (
        '<link name="tool0"/><joint name="flange" type="fixed"><parent link="bar"/>'
        '<child link="tool0"/><origin xyz="0 0 -0.4" rpy="0 0 0"/></joint></robot>'
    )
    load_robot(edited(tmp_path, SINGLE_JOINT, "arm.urdf", "</robot>", tool))


def test_an_identified_value_is_refused_with_its_own_line(tmp_path: Path) -> None:
    gap = "gap: {date: d, log: l, half_gap: 0.3, confidence: 0.0}"
    arm = edited(tmp_path, SINGLE_JOINT, "identified.yaml", "gap: null", gap)
    with pytest.raises(ConfigurationError) as caught:
        load_robot(arm)
    path = arm / "identified.yaml"
    line = 1 + next(i for i, x in enumerate(path.read_text().splitlines()) if "0.3" in x)
    where = f"{path}:{line}: joints[0] (joint).half_gap"
    words = "0.3 rad is outside the possible range: up to 0.175"
    assert str(caught.value).startswith(f"{where}: {words}")


# --- nothing gets round them ----------------------------------------------------------------------

ROBOT = load_robot(SINGLE_JOINT)
FIELDS: tuple[tuple[str, ...], ...] = (
    *((name,) for name in ("torque_constant", "rotor_inertia", "half_gap")),
    *(("thresholds", name) for name in ("contact", "collision", "per_speed")),
    *(("wiring", name) for name in ("max_current_A",)),
    *(
        ("friction", name)
        for name in (
            *("motor_coulomb", "motor_viscous", "link_coulomb", "link_viscous"),
            *("gap_coulomb", "gap_viscous", "stiction"),
        )
    ),
)


def changed(joint: msgspec.Struct, path: tuple[str, ...], value: float) -> msgspec.Struct:
    name, *rest = path
    inner = changed(getattr(joint, name), tuple(rest), value) if rest else value
    return msgspec.structs.replace(joint, **{name: inner})


numbers = st.floats(-12.0, 12.0).map(lambda power: 10.0**power)


@st.composite
def configurations(draw: st.DrawFn) -> Configuration:
    """The single joint with some figures as far off as they may be written."""
    c, joint = ROBOT.configuration, ROBOT.configuration.joints[0]
    for path in draw(st.lists(st.sampled_from(FIELDS), unique=True, max_size=3)):
        value = draw(st.floats(0.0, 1.0)) if path[-1] == "stiction" else draw(numbers)
        joint = changed(joint, path, value)  # type: ignore[assignment]
    gain = draw(st.one_of(st.just(25.0), numbers.filter(lambda k: 0.0 < k < 199.0)))
    settings_ = msgspec.structs.replace(
        c.estimator,
        gain=gain,
        debounce=draw(st.integers(1, 100)),
        stiction_share=draw(st.floats(0.0, 2.0)),
        unknown_side_share=draw(st.floats(0.0, 2.0)),
    )
    return msgspec.structs.replace(c, joints=[joint], estimator=settings_)


def detects(c: Configuration) -> bool:
    """True if the estimator, built from the configuration, detects half of the motor's torque in
    motion after 0.15 s of twice the level, and all of it at rest."""
    joint: Joint = c.joints[0]
    estimator = build_estimator(c, ROBOT.model)
    motor = joint.torque_constant * joint.wiring.max_current_A
    levels = estimator.detector.levels
    in_motion = levels.configured(0, joint.limits.velocity)
    hidden = levels.friction_at(0, 1.0, stiction_range(joint.friction.stiction)[1], 1.0, 0.0)
    at_rest = levels.contact_at(0, hidden + levels.uncertainty(0, True, False, False, 0.0))
    residual = Residual([Variant()], c.estimator.gain, c.period_s, 1)
    ticks = 0
    impulse = np.zeros(len(ROW))
    impulse[ROW["momentum"]] = 2.0 * c.period_s
    while residual.values[0, 0] <= 1.0 and ticks < 1000:  # of the level; twice that presses
        residual.step(0, impulse, 0.0, True, c.period_s)
        ticks += 1
    delay = ticks + c.estimator.debounce - 1
    # The trapezoid rounds the delay to whole periods.
    return in_motion <= 0.501 * motor and at_rest <= 1.001 * motor and delay <= 16


@given(c=configurations())
def test_an_accepted_arm_detects_contact(c: Configuration) -> None:
    if not beyond(c, ROBOT.model):
        assert detects(c)


@given(path=st.sampled_from(FIELDS[:-1]), factor=st.floats(1.01, 1e9))
def test_a_single_value_beyond_its_bound_is_found(path: tuple[str, ...], factor: float) -> None:
    joint = ROBOT.configuration.joints[0]
    where = f"joints[0] (joint).{'.'.join(path)}"
    bounds = [b for b in bounded(ROBOT.configuration, ROBOT.model) if b.where == where]
    high = min(b.high for b in bounds)
    c = msgspec.structs.replace(ROBOT.configuration, joints=[changed(joint, path, factor * high)])
    assert where in [problem.where for problem in beyond(c, ROBOT.model)]


@pytest.mark.parametrize(("times", "refused"), [(9.9, False), (10.1, True)])
def test_a_current_of_no_motor(times: float, refused: bool) -> None:
    """Behind an EDS that would allow it."""
    joint = ROBOT.configuration.joints[0]
    wiring = joint.wiring
    current = times * wiring.rated_current_A
    c = msgspec.structs.replace(
        ROBOT.configuration, joints=[changed(joint, ("wiring", "max_current_A"), current)]
    )
    found = [problem.where for problem in beyond(c, ROBOT.model)]
    assert found == (["joints[0] (joint).wiring.max_current_A"] if refused else [])


def test_the_check_can_fail() -> None:
    """`detects` is false for an arm that does not."""
    joint = changed(ROBOT.configuration.joints[0], ("thresholds", "contact"), 800.0)
    joint = changed(joint, ("thresholds", "collision"), 900.0)
    c = msgspec.structs.replace(ROBOT.configuration, joints=[joint])
    assert not detects(c)
    slow = msgspec.structs.replace(ROBOT.configuration.estimator, gain=3.0)
    assert not detects(msgspec.structs.replace(ROBOT.configuration, estimator=slow))
    assert detects(ROBOT.configuration)


@pytest.mark.parametrize("period_ms", [1, 4, 10, 20, 40, 50, 100])
def test_a_period_with_long_gaps_of_sensing_is_reported(period_ms: int) -> None:
    robot = load_robot(SINGLE_JOINT)
    c = msgspec.structs.replace(robot.configuration, period_ms=period_ms)
    warnings = [p.what for p in near(c, robot.model) if p.where == "period_ms"]
    assert len(warnings) == (period_ms > 40)
    tolerated = tolerated_ticks(period_ms / 1000)
    assert 1 <= tolerated <= 5
    if period_ms <= 40:
        assert (SENSED_PERIODS + tolerated) * period_ms <= 150
    # No sooner than it must: on a fast loop a few samples are no doubt.
    assert tolerated == 5 or (tolerated + 1) * period_ms > 60
