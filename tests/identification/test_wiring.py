"""Wiring errors in a motion of 20 mrad: a wrong sign, a wrong scale, another joint's drive."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bench.rigs.arm_batch import record_fleet
from identification.motion_log import MotionLog
from identification.wiring import OTHER_WAY, check_wiring, scale_uncertain, swapped_pairs
from programs.identify.motions import WIRING_SPEED, WIRING_TRAVEL, wiring_motion
from simulator.description import SimulationSettings
from simulator.mismatch import true_parameters

SHOULDER, ELBOW, WRIST = 0, 2, 5  # gravity and a gap; a small gap; no gap and no gravity


@pytest.fixture(scope="session")
def wired(arm) -> MotionLog:
    """Three joints moved as `contactd identify wiring` does, at a pose with gravity; the arm is off
    by what simulation.yaml says."""
    settings = SimulationSettings()
    pose = np.array([0.5, 0.3, 0.0, -0.8, -1.5, 0.0, 0.0])
    paths = [
        wiring_motion(pose, i, arm.transmission.half_gap[i], 0.01) for i in (SHOULDER, ELBOW, WRIST)
    ]
    seconds = max(len(path) for path in paths) * 0.01 + 0.5
    speed = np.zeros((round(seconds / 0.01) + 1, 7))
    for i, path in zip((SHOULDER, ELBOW, WRIST), paths, strict=True):
        speed[40 : 40 + len(path), i] = np.gradient(path[:, i], 0.01)
    true = true_parameters(arm.description, settings)
    logs = record_fleet(
        arm.description,
        [true],
        lambda t: (pose, speed[min(round(t / 0.01), len(speed) - 1)]),
        seconds,
        settings,
        motors_only=True,
    )
    # The simulated drives take the arm's weight only when it has begun to fall.
    return logs[0][0].select(slice(30, None))


@pytest.fixture
def check(arm):
    t = arm.transmission

    def run(log: MotionLog, joint: int):
        return check_wiring(log, joint, arm.model, float(t.torque_constant[joint]))

    return run


def scaled(log: MotionLog, field: str, factor: float, joint: int) -> MotionLog:
    by = np.where(np.arange(log.n) == joint, factor, 1.0)
    return replace(log, **{field: getattr(log, field) * by})


@pytest.mark.parametrize("joint", [SHOULDER, ELBOW, WRIST])
def test_a_well_wired_joint_passes(wired, check, joint):
    found = check(wired, joint)
    assert found.passed, found
    assert found.follows == pytest.approx(1.0, abs=0.02)
    assert found.friction > 0.0


@pytest.mark.parametrize(
    ("joint", "counts"), [(SHOULDER, 2.6), (ELBOW, 2.6), (WRIST, 2.6), (SHOULDER, 0.7)]
)
def test_a_coarse_velocity_beside_a_position_is_no_wrong_scale(wired, check, joint, counts):
    """A steady speed between two counts reads as one of them."""
    count = WIRING_SPEED / counts
    coarse = np.floor(wired.motor_velocity / count + 0.5) * count
    assert wired.motor_position is not None
    found = check(replace(wired, motor_velocity=coarse), joint)
    assert found.passed, found
    assert found.follows == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("factor", [-1.0, 0.0])
def test_a_position_that_goes_another_way_than_its_motor_is_alone_to_blame(wired, check, factor):
    (problem,) = check(scaled(wired, "motor_position", factor, ELBOW), ELBOW).problems
    assert problem.startswith("motor_position changes")


@pytest.mark.parametrize(
    ("scale", "unsure"),
    [(1.0, False), (0.98, False), (0.9, True), (1.1, True), (0.8, True), (0.6, False), (1.5, False),
     (-1.0, False), (0.0, False)],
)  # fmt: skip
def test_a_share_that_chance_may_make_is_measured_again(wired, scale, unsure):
    assert scale_uncertain(scaled(wired, "link_position", scale, ELBOW), ELBOW) is unsure


def test_a_link_that_falls_to_its_other_border_is_no_wrong_scale(wired, check):
    """Place where gravity turns: the link runs ahead of a motor that goes back, and halts it
    for a moment when it strikes: a short, steady way of the motor in which the gear carries
    nothing."""
    moving = np.flatnonzero(np.abs(wired.motor_velocity[:, SHOULDER]) > 0.5 * WIRING_SPEED)
    back = moving[np.flatnonzero(np.diff(wired.motor_velocity[moving, SHOULDER] > 0.0))[0] + 1]
    velocity, link = wired.motor_velocity.copy(), wired.link_position.copy()
    falls = slice(back, back + 28)
    way = np.cumsum(velocity[falls, SHOULDER]) * wired.period_s
    link[back : back + 28, SHOULDER] = link[back, SHOULDER] - 0.7 * way
    velocity[back + 28 : back + 31, SHOULDER] = 0.0
    found = check(replace(wired, motor_velocity=velocity, link_position=link), SHOULDER)
    assert found.passed, found
    assert found.follows == pytest.approx(1.0, abs=0.02)


def floating(log: MotionLog, up: float, down: float) -> MotionLog:
    """The elbow's link going farther than its motor, each way by a share of its own, as one does
    that nothing holds and that its gear strikes ahead."""
    link, motor = log.link_position.copy(), log.motor_velocity[:, ELBOW]
    share = np.where(motor > 0.0, up, down)[1:]
    link[1:, ELBOW] = link[0, ELBOW] + np.cumsum(np.diff(link[:, ELBOW]) * share)
    return replace(log, link_position=link)


def test_a_link_that_floats_in_its_gap_shows_nothing_of_the_gear(wired, check):
    found = check(floating(wired, 1.0, 1.18), ELBOW)
    assert not found.passed
    assert not found.problems
    (undetermined,) = found.undetermined
    assert "floats in its gap" in undetermined
    assert "repeat it" in undetermined


def test_shares_that_differ_are_measured_again_though_their_mean_is_right(wired):
    assert scale_uncertain(floating(wired, 0.93, 1.07), ELBOW)


def test_ways_that_agree_tell_a_gear_that_is_wrong(wired, check):
    (problem,) = check(floating(wired, 1.1, 1.12), ELBOW).problems
    assert "times as far as the motor reports" in problem


def test_gravity_is_compared_where_there_is_some(wired, check):
    found = check(wired, SHOULDER)
    assert found.held == pytest.approx(found.gravity, rel=0.15)
    assert abs(found.gravity) > 1.0
    assert abs(check(wired, WRIST).gravity) < 0.1


def test_a_torque_constant_that_gravity_does_not_check_is_said_to_be_open(wired, check, arm):
    rubs = replace(wired, current=wired.current + 0.3 * np.sign(wired.motor_velocity))
    (never,) = check(rubs, WRIST).notes
    assert "gravity hardly acts" in never
    poses = np.random.default_rng(1).uniform(arm.model.lower, arm.model.upper, (300, wired.n))
    pose = min(poses, key=lambda q: abs(arm.model.gravity(q)[SHOULDER]))
    held = check(wired, SHOULDER).held / arm.transmission.torque_constant[SHOULDER]
    (here,) = check(
        replace(
            wired,
            link_position=wired.link_position - wired.link_position.mean(axis=0) + pose,
            current=wired.current - held * (np.arange(wired.n) == SHOULDER),
        ),
        SHOULDER,
    ).notes
    assert "a pose shows it in which the joint carries more, up to" in here


@pytest.mark.parametrize("joint", [SHOULDER, ELBOW, WRIST])
@pytest.mark.parametrize(
    ("fields", "factor", "says"),
    [(["link_position"], -1.0, "link_sign or motor_sign"),
     (["motor_velocity", "motor_position"], -1.0, "link_sign or motor_sign"),
     (["motor_velocity", "motor_position"], 1.1, "times as far as the motor reports"),
     (["motor_velocity", "motor_position"], 1 / 1.1, "times as far as the motor reports"),
     (["motor_position"], 1.1, "motor_position changes 1."),
     (["current"], -1.0, "sign of the current"),
     (["motor_velocity"], 0.001, "the motor turned only"),
     (["link_position"], 0.001, "wrong gear, link_position object or scale")],
)  # fmt: skip
def test_what_is_wired_wrong_is_named(wired, check, joint, fields, factor, says):
    log = only(wired, joint)
    for field in fields:
        log = scaled(log, field, factor, joint)
    found = check(log, joint)
    assert not found.passed
    assert any(says in problem for problem in found.problems), found.problems


def test_a_turned_motor_explains_the_sign_of_its_current_too(wired, check):
    turned = ["motor_velocity", "motor_position", "current"]
    log = only(wired, SHOULDER)
    for field in turned:
        log = scaled(log, field, -1.0, SHOULDER)
    assert check(log, SHOULDER).problems == (OTHER_WAY,)
    (_, gravity) = check(scaled(log, "current", 3.0, SHOULDER), SHOULDER).problems
    assert "torque_constant" in gravity


def swapped(log: MotionLog, one: int, other: int, fields: tuple[str, ...]) -> MotionLog:
    order = np.arange(log.n)
    order[[one, other]] = other, one
    return replace(log, **{field: getattr(log, field)[:, order] for field in fields})


def only(log: MotionLog, joint: int) -> MotionLog:
    """As if the others had stood."""
    others = np.arange(log.n) != joint
    return replace(
        log,
        link_position=np.where(others, log.link_position[0], log.link_position),
        motor_velocity=np.where(others, 0.0, log.motor_velocity),
        motor_position=np.where(others, log.motor_position[0], log.motor_position),
    )


def test_link_encoders_of_two_joints_are_swapped(wired, check):
    log = swapped(only(wired, SHOULDER), SHOULDER, 1, ("link_position",))
    (problem,) = check(log, SHOULDER).problems
    assert "LShoulderYaw moved" in problem
    assert "swapped" in problem


def test_whole_drives_are_swapped(wired, check):
    """Their encoders agree with each other; gravity does not."""
    everything = ("current", "link_position", "motor_velocity", "motor_position")
    log = swapped(wired, SHOULDER, ELBOW, everything)
    assert any("gravity" in problem for problem in check(log, SHOULDER).problems)


@pytest.mark.parametrize("speeding_up", [False, True])
def test_the_motion_is_small(arm, speeding_up):
    for i, alpha in enumerate(arm.transmission.half_gap):
        here = np.zeros(7)
        path = wiring_motion(here, i, alpha, 0.01, speeding_up=speeding_up)
        assert np.ptp(path[:, i]) == pytest.approx(2 * alpha + WIRING_TRAVEL, abs=0.008)
        assert path[-1] == pytest.approx(here, abs=1e-9)
        assert np.abs(np.diff(path[:, i])).max() <= WIRING_SPEED * 0.01 + 1e-9
        assert (np.delete(path, i, axis=1) == 0.0).all()


@pytest.mark.parametrize(
    ("follows", "pairs"),
    [({"a": 0.832, "b": 1.0, "c": 1.199}, [("a", "c")]), ({"a": 0.832, "b": 1.1}, []),
     ({"a": 1.02, "b": 0.98}, []), ({"a": -0.832, "b": -1.199}, []),
     ({"a": math.nan, "b": 1.2}, []), ({}, [])],
)  # fmt: skip
def test_gears_that_are_each_others_name_the_pair(
    follows: dict[str, float], pairs: list[tuple[str, str]]
) -> None:
    assert swapped_pairs(follows) == pairs


@pytest.mark.parametrize("joint", [SHOULDER, ELBOW, WRIST])
@pytest.mark.parametrize("held", [0.0, 1.0])
def test_a_current_that_never_changes_is_no_measurement(wired, check, joint, held):
    set_value = wired.current.copy()
    set_value[:, joint] = held
    found = check(replace(wired, current=set_value), joint)
    assert any("throughout" in problem for problem in found.problems)


@pytest.mark.parametrize(("way", "kept"), [(1.0, True), (-1.0, False), (0.0, False)])
def test_a_motor_that_friction_holds_is_no_deaf_drive(wired, check, way: float, kept: bool):
    """The integral of its loop rises the way of the setpoints."""
    asked = np.cumsum(wired.motor_velocity[:, WRIST])
    current, velocity = wired.current.copy(), wired.motor_velocity.copy()
    noise = np.random.default_rng(1).normal(0.0, 0.01, len(asked))
    current[:, WRIST] = way * 0.3 * asked / np.ptp(asked) + noise
    velocity[:, WRIST] = 0.0
    link = wired.link_position.copy()
    link[:, WRIST] = link[0, WRIST]
    log = replace(wired, current=current, motor_velocity=velocity, link_position=link)
    found = check(replace(log, setpoint=wired.motor_velocity), WRIST)
    assert (bool(found.undetermined), bool(found.problems)) == (kept, not kept)
    moved = replace(log, setpoint=wired.motor_velocity, link_position=wired.link_position)
    assert check(moved, WRIST).problems  # its velocity is in another unit
