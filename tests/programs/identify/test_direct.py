"""`contactd identify friction --direct`, of arms whose gears and friction are not the model's."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from bench.rigs.arm_without_bus import Course, Push, Scenario, Subject, record
from bench.rigs.lockstep import ROMEO
from common.errors import LogError
from daemon.config.load import load_robot
from daemon.config.schema import Levels
from identification.direct_friction import Point, grouped_strokes, points
from identification.motion_log import MotionLog
from programs.contactd.contactd import main
from programs.identify.direct_motion import direct_motion
from programs.identify.direct_outcome import direct_outcome, disagreement, law_of
from programs.identify.measured import Measured
from programs.identify.motions import SHARE, bounds_of
from programs.simulate.simulated_robot import describe, read_simulation
from simulator.description import Mismatch, SimulationSettings
from simulator.gear_settings import GearSettings
from simulator.mismatch import true_parameters
from tests.programs.identify.typed_session import TypedCommand, stopped, wired_joint

TICK_S, LATE_S, LOAD, RISE, FALLS = 0.01, 0.003, 0.12, 1.25, 0.05
OFF = Mismatch(mass=5, center_of_mass=5, friction=20, torque_constant=2, half_gap=10)
REAL = SimulationSettings(
    friction="dahl", presliding=0.001, stribeck=RISE, stribeck_velocity=FALLS, seed=3,
    mismatch=OFF, gears=GearSettings(load_driving=LOAD, load_driven=LOAD),
)  # fmt: skip
EXACT = msgspec.structs.replace(
    REAL, stribeck=1.0, mismatch=Mismatch(mass=5, friction=0, torque_constant=0, half_gap=10)
)
ROBOT = load_robot(ROMEO)
C, JOINTS = ROBOT.configuration, ROBOT.configuration.joint_names


def log_of(i: int, settings: SimulationSettings, *pushes: Push) -> MotionLog:
    """The whole motion of joint i, which stays within its share of the limits."""
    inner = bounds_of(C).shrunk(SHARE)
    path, planned = direct_motion(C, ROBOT.model, i, 0.5 * (inner.lower + inner.upper))
    speed = np.gradient(path, TICK_S, axis=0)
    assert planned == 12
    assert ((path >= inner.lower - 1e-9) & (path <= inner.upper + 1e-9)).all()
    assert (np.abs(speed) <= inner.velocity + 1e-6).all()
    assert (np.abs(np.diff(path, 2, axis=0)) <= 1.1 * TICK_S**2 * inner.acceleration).all()
    scenario = Scenario(seconds=TICK_S * len(path), motion=Course(path, speed), pushes=pushes)
    recording = record(Subject(robot=ROBOT, settings=settings), scenario)
    return MotionLog(tuple(JOINTS), recording.time_s, *np.moveaxis(recording.samples, 1, 0))


@pytest.mark.parametrize(("i", "push"), [(3, 0.0), (6, 0.0), (3, 0.4)])
def test_points_hold_the_truth_within_their_scatter(i, push) -> None:
    """Gaps of 11 mrad, and of 23 mrad with little gravity; and a joint that is touched once."""
    true = true_parameters(describe(ROBOT, read_simulation(ROBOT)), REAL)
    coulomb, viscous = (of.reshape(2, -1)[:, i] for of in (true.coulomb, true.viscous))
    constant, off = C.joints[i].torque_constant, []
    scale = constant / true.torque_constant[i]
    touch = Push(24_500, 1_000, push * (np.arange(7) == i))
    groups = grouped_strokes(log_of(i, REAL, touch), i, constant, LATE_S)
    for p in (found := points(groups)):
        rise = 1.0 + (RISE - 1.0) * np.exp(-np.square(p.speed / FALLS))
        load = LOAD * max(abs(p.load) / scale, coulomb[0] * rise + viscous[0] * p.speed)
        friction = scale * ((coulomb.sum() + load) * rise + viscous.sum() * p.speed)
        off.append(abs(p.friction - friction) / p.scatter)
    assert max(off) < 1.0, found
    scatter = [p.scatter / p.friction for p in found]
    assert np.median(scatter) < 0.03
    assert push == 0.0 or max(scatter) > 0.1
    assert len(groups) >= 9
    assert min(p.speed for p in found) < FALLS < 6.0 * FALLS < max(p.speed for p in found)
    assert np.ptp([abs(p.load) for p in found]) > 0.5 * min(p.friction for p in found)


@pytest.fixture(scope="module")
def log() -> MotionLog:
    """LElbowYaw with the friction of the configuration, and more of it under load."""
    return log_of(3, EXACT)


@pytest.mark.parametrize(
    ("load", "coulomb", "level", "says"),
    [((0.1, 0.14), 0.35, 0.3, ""), (None, 0.35, 0.3, "a hand must press"),
     ((0.1, 0.14), 0.25, 0.08, "false contacts")],
)  # fmt: skip
def test_a_law_that_is_wrong_is_named_and_stays(log, load, coulomb, level, says) -> None:
    joints = list(C.joints)
    law = msgspec.structs.replace(joints[3].friction, load=load, motor_coulomb=coulomb)
    levels = Levels(contact=level, collision=2.5)
    joints[3] = msgspec.structs.replace(joints[3], friction=law, thresholds=levels)
    robot = replace(ROBOT, configuration=msgspec.structs.replace(C, joints=joints))
    outcome = direct_outcome(robot, Measured(log, ""), ["LElbowYaw", "LWristYaw"])
    line, still = outcome.lines
    assert (line.verdict, still.verdict) == ("disagrees" if says else "agrees", "not seen"), line
    assert says in line.reason
    assert bool(line.reason) == bool(outcome.notes) == (not line.good) == bool(says)
    assert not outcome.entries
    friction = coulomb + 0.035 + 0.165 * 0.4 + (0.12 * 2.0 if load else 0.0)
    half = 0.04 if load else 0.0
    assert law_of(robot, 3).at(-2.0, 0.4) == pytest.approx((friction, half), abs=1e-6)


@pytest.mark.parametrize("scale", [0.0, -1.0])
def test_a_current_that_is_missing_or_reversed_is_named(log, scale) -> None:
    wrong = Measured(replace(log, current=scale * log.current), "")
    outcome = direct_outcome(ROBOT, wrong, ["LElbowYaw"])
    assert [line.verdict for line in outcome.lines] == ["implausible"]
    assert "its sign right?" in outcome.lines[0].reason
    assert outcome.draw is None
    found = points(grouped_strokes(wrong.log, 3, 1.0, LATE_S))
    assert all(point.scatter >= 0.0 for point in found)


def test_a_current_in_another_unit_is_refused(log) -> None:
    wrong = Measured(replace(log, current=1000.0 * log.current), "")
    with pytest.raises(LogError, match=r"current of LElbowYaw reaches .* unit wrong by 1000"):
        direct_outcome(ROBOT, wrong, ["LElbowYaw"])


@pytest.mark.parametrize(
    ("count", "off", "by", "agrees"),
    [(19, 2, 1.5, True), (19, 4, 1.5, False), (19, 1, 2.5, False), (4, 1, 1.5, True),
     (4, 2, 1.5, False)],
)  # fmt: skip
def test_as_many_points_may_be_off_as_intervals_leave_out(count, off, by, agrees) -> None:
    """By less than two of them, of however many speeds and loads were reached."""
    law, scatter = law_of(ROBOT, 3), 0.02
    friction, half = law.at(0.5, 0.3)
    beyond = [by * (scatter + half) * (k < off) for k in range(count)]
    found = [Point(0.5, 0.3, friction + more, scatter) for more in beyond]
    assert bool(disagreement(law, found, 0.3, 0.0)) is not agrees


def test_a_joint_that_does_not_exist_is_named_also_beside_all(tmp_path) -> None:
    words = ["--config", str(ROMEO), "--log", str(tmp_path / "none.csv"), "--direct", "all"]
    said = CliRunner().invoke(main, ["identify", "friction", *words, "--direct", "LElbow"])
    assert "no joint LElbow; there are:" in said.stderr


def test_it_goes_on_after_a_stop_and_changes_nothing(tmp_path) -> None:
    arm = wired_joint(tmp_path)
    kept, before = arm.folder / "identify", (arm.folder / "identified.yaml").read_bytes()
    with arm.served() as served:
        served.rig.enable()
        assert stopped(served, "friction", "--direct", "all")[0] == 1
        assert [path.name for path in kept.iterdir()] == ["direct.part01.mcap"]
        status, said = TypedCommand(served, "friction", "--direct", "joint").ends()
    assert (status, len(list(kept.glob("direct-2*.mcap")))) == ("disagrees" in said, 2)
    logs = [word for path in kept.glob("direct-2*.mcap") for word in ("--log", str(path))]
    words = ["identify", "friction", "--direct", "joint", "--config", str(arm.folder), *logs]
    assert CliRunner().invoke(main, words).exit_code == status
    assert (kept / "friction-direct.png").is_file()
    assert (arm.folder / "identified.yaml").read_bytes() == before
