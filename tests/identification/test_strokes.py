"""The gap without a hand: strokes of a motor, the search over them, and poses to make them in."""

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import ROMEO
from daemon.config.load import load_robot
from estimator.model import Model
from identification.balance import balanced_pose
from identification.gap import identify_gap
from identification.gap_result import GapResult, GapVerdict
from identification.gap_search import FURTHEST, WIDEST, Search, Strokes, search
from identification.motion_log import MotionLog
from identification.stroke_fit import StrokeFit
from identification.stroke_samples import stroking
from identification.strokes import STROKES, _judged, from_strokes
from simulator.description import SimulationSettings
from tests.identification.gap_plants import GUESS, Joint, answers, pendulum, random_joint, searched

SETTINGS = SimulationSettings(friction="dahl", presliding=0.0003, velocity_bias=0.0007, seed=1)


def joint(want: Callable[[Joint], bool] = lambda _: True, **plant: float) -> Joint:
    """A random joint as wanted, some of its plant's values replaced."""
    rng = np.random.default_rng(4)
    found = next(one for one in (random_joint(rng, SETTINGS) for _ in range(500)) if want(one))
    values = {name: np.array([value]) for name, value in plant.items()}
    return replace(found, plant=replace(found.plant, **values))


def loaded(one: Joint) -> bool:
    return 2.0 < one.gravity < 8.0 and one.lower < -1.0 and one.has_motor_position


def test_joints_of_all_sorts_are_answered_within_their_intervals():
    found = answers((30, 5, 0))
    observable = [one for one in found if one.observable]
    answered = [one for one in found if one.answered]
    assert len(answered) >= 0.9 * len(observable)
    assert all(one.observable for one in answered)
    assert all(one.reason for one in found)
    off = [abs(one.found - one.half_gap) for one in answered]
    assert sum(e > one.confidence for e, one in zip(off, answered, strict=True)) <= 1
    for error, one in zip(off, answered, strict=True):
        assert error < max(0.05 * one.half_gap, 0.0005), one


@pytest.mark.parametrize("alpha", [0.004, 0.05])
def test_what_the_gear_bends_is_taken_off(alpha):
    # Soft, and a link whose friction alone bends it by more than a milliradian.
    soft = joint(loaded, half_gap=alpha, stiffness=400.0)
    soft = replace(soft, plant=replace(soft.plant, coulomb=np.array([0.5, 0.6])))
    [(found, _)] = searched([soft], GUESS, SETTINGS)
    assert found.verdict is GapVerdict.CLEAR, found
    assert found.half_gap == pytest.approx(alpha, abs=found.confidence)
    assert found.half_gap == pytest.approx(alpha, abs=max(0.02 * alpha, 0.0003))
    assert found.compliance == pytest.approx(1.0 / 400.0, rel=0.3)


@pytest.mark.parametrize(("alpha", "link"), [(0.0012, 0.3), (0.0015, 0.3), (0.0016, 0.4)])
def test_a_narrow_gap_shows_in_which_a_strong_motors_friction_turns_round(alpha, link):
    """3 Nm, as at the upright joints of an arm of 5 kg: the motor is never seen free."""
    strong = joint(lambda one: one.gravity == 0.0 and one.has_motor_position,
                   half_gap=alpha, rotor_inertia=0.55, lightest_link=0.6, usual_link=0.6,
                   stiffness=1500.0, torque_constant=5.0)  # fmt: skip
    friction = {"coulomb": np.array([link, 3.0]), "viscous": np.array([0.04, 3.0])}
    plant = replace(strong.plant, **friction, model=pendulum(0.0, 0.6))
    drive = replace(strong.description, torque_constant=5.15, gear=100.0, rated_current_A=5.2,
                    max_current_A=15.0)  # fmt: skip
    strong = replace(strong, plant=plant, description=drive)
    [(found, _)] = searched([strong], GUESS, msgspec.structs.replace(SETTINGS, presliding=0.0005))
    assert found.verdict is GapVerdict.CLEAR, found
    assert abs(found.half_gap - alpha) < found.confidence < 0.0009, found


def test_a_rigid_joint_has_no_gap_and_a_loaded_one_is_not_called_rigid():
    rigid = joint(loaded, half_gap=0.0)
    [(found, _)] = searched([rigid], GUESS, SETTINGS)
    assert (found.verdict, found.half_gap) == (GapVerdict.NONE, 0.0), found
    # Its balance is far from where the URDF has it: the link never leaves one border.
    held = replace(joint(loaded, half_gap=0.02), believed=-1.0)
    [(found, _)] = searched([held], GUESS, SETTINGS)
    assert found.verdict in (GapVerdict.ONE_BORDER, GapVerdict.TOO_SHORT), found
    assert not found.usable
    assert "one border" in found.reason


def test_errors_of_the_motor_encoder_are_found_and_reported():
    size = 0.0004
    wrong = replace(joint(loaded, half_gap=0.01), motor_error=np.array([[size, 1.0], [0.0, 0.0]]))
    [(found, _)] = searched([wrong], GUESS, SETTINGS)
    assert found.half_gap == pytest.approx(0.01, abs=0.0002), found
    [harmonic] = [one for one in found.harmonics if one.order == 1]
    assert harmonic.encoder == "motor"
    assert harmonic.amplitude == pytest.approx(size, rel=0.15)


@pytest.mark.parametrize("seed", [0, 1, 2, 4, 7])
@pytest.mark.parametrize("held", [False, True])
def test_a_link_that_floats_is_for_the_hand_and_no_encoder_is_blamed(seed, held):
    rng = np.random.default_rng(seed)
    plenty = (random_joint(rng, SETTINGS) for _ in range(500))
    one = next(one for one in plenty if one.gravity == 0.0 and one.has_motor_position)
    rub = {"coulomb": [0.1 * held, one.plant.coulomb[1]], "viscous": [0.0, one.plant.viscous[1]]}
    values = {"half_gap": [0.006], **rub}
    plant = replace(one.plant, **{name: np.array(value) for name, value in values.items()})
    right = {"link_error": 0.0 * one.link_error, "motor_error": 0.0 * one.motor_error}
    [(found, _)] = searched([replace(one, plant=plant, **right)], GUESS, SETTINGS)
    assert found.usable is held, found
    assert not found.harmonics
    if held:
        assert found.half_gap == pytest.approx(0.006, abs=found.confidence)
    else:
        assert "floats" in found.limit.name
        assert f"`contactd identify gap {found.joint} --by-hand`" in found.limit.cause


def concluded(steps: Search, record: Callable[[Strokes], MotionLog]) -> GapResult:
    """Result of a search."""
    asked = next(steps)
    while True:
        try:
            asked = steps.send(record(asked))
        except StopIteration as end:
            return end.value


def stroke_log(way: float, speed: float, follows: float) -> MotionLog:
    """Three strokes of a motor whose link moves by a share of that."""
    t = np.arange(0.0, 3.0 * way / speed, 0.01)
    velocity = speed * np.where((t * speed / way) % 2.0 < 1.0, 1.0, -1.0)
    theta = np.cumsum(velocity) * 0.01
    columns = [np.sign(velocity), follows * theta, velocity, theta]
    return MotionLog(("j",), t, *(column[:, None] for column in columns))


def test_the_search_goes_further_and_further_but_not_for_ever():
    asked: list[Strokes] = []
    steps = search(0, 1.0, 100.0, 0.01, lambda pose: 0.0, 0.0, (-2.0, 2.0))

    def standing(asked_for: Strokes) -> MotionLog:
        asked.append(asked_for)
        return stroke_log(asked_for.travel, asked_for.speed, 0.0)

    found = concluded(steps, standing)
    assert found.verdict is GapVerdict.TOO_SHORT
    ways = [one.travel for one in asked]
    assert ways == sorted(ways)
    assert ways[-1] == pytest.approx(2.0 * WIDEST + 0.03)
    assert len(asked) < 8
    assert max(one.speed for one in asked) <= 0.03


def crossing_log(asked: Strokes, half_gap: float, shaken: float) -> MotionLog:
    """Strokes of a motor whose link rests by its friction but for the gap's borders, and is shaken
    by a hand [rad]."""
    t = np.arange(0.0, asked.count * asked.travel / asked.speed, 0.01)
    velocity = asked.speed * np.where((t * asked.speed / asked.travel) % 2.0 < 1.0, 1.0, -1.0)
    theta, q, at = np.cumsum(velocity) * 0.01, np.empty_like(t), 0.0
    for k, motor in enumerate(theta):
        q[k] = at = np.clip(at, motor - half_gap, motor + half_gap)
    torque = np.where(np.abs(q - theta) < 0.99 * half_gap, 0.2, 1.0) * np.sign(velocity)
    q += shaken * np.sin(0.4 * t)
    columns = [torque, q, velocity, theta]
    return MotionLog(("j",), t, *(column[:, None] for column in columns))


@pytest.mark.parametrize(
    ("shaken", "verdict", "counts"),
    [([0.0, 0.0], GapVerdict.CLEAR, [2, STROKES]),
     ([0.0, 0.005, 0.0], GapVerdict.CLEAR, [2, STROKES, 2 * STROKES]),
     ([0.0, 0.005, 0.005], GapVerdict.UNCLEAR, [2, STROKES, 2 * STROKES])],
)  # fmt: skip
def test_what_strokes_left_unclear_is_looked_at_once_more(shaken, verdict, counts):
    asked: list[Strokes] = []
    steps = search(0, 1.0, 100.0, 0.01, lambda pose: 0.0, 0.0, (-2.0, 2.0))

    def recorded(one: Strokes) -> MotionLog:
        asked.append(one)
        return crossing_log(one, 0.01, shaken[len(asked) - 1])

    found = concluded(steps, recorded)
    assert found.verdict is verdict
    assert [one.count for one in asked] == counts


@pytest.mark.parametrize("room", [(-2.0, 2.0), (-0.01, 0.5), (-0.5, 0.01), (-0.01, 0.02)])
def test_strokes_stay_within_the_limits(room):
    steps = search(0, 1.0, 100.0, 0.01, lambda pose: 0.0, 0.0, room)
    one = next(steps)
    assert room[0] <= one.about - 0.5 * one.travel
    assert one.about + 0.5 * one.travel <= room[1]
    assert one.travel <= 2.0 * WIDEST + FURTHEST


@pytest.mark.parametrize(
    ("period_s", "speed"), [(0.002, 0.03), (0.01, 0.03), (0.02, 0.015), (0.1, 0.007)]
)
def test_a_motor_that_is_seldom_sampled_turns_slowly(period_s, speed):
    """Between two samples it goes on, which is in the interval of the gap."""
    steps = search(0, 1.0, 100.0, 0.02, lambda pose: 0.0, 0.0, (-2.0, 2.0), period_s)
    scouts = next(steps)
    final = steps.send(crossing_log(scouts, 0.02, 0.0))
    assert (scouts.speed, final.speed) == pytest.approx((speed, speed))


def test_a_balanced_pose_is_near_and_hangs():
    robot = load_robot(ROMEO)
    c = robot.configuration
    model = Model(robot.urdf, c.joint_names)
    lower = np.array([j.limits.lower for j in c.joints])
    upper = np.array([j.limits.upper for j in c.joints])
    here = 0.5 * (lower + upper)
    shoulder = balanced_pose(model, 0, here, lower, upper, 0.01)
    assert shoulder is not None
    assert np.count_nonzero(shoulder != here) == 1
    step = np.eye(len(here))[0] * 0.05
    assert model.gravity(shoulder)[0] == pytest.approx(0.0, abs=0.02)
    assert model.gravity(shoulder + step)[0] > model.gravity(shoulder - step)[0]
    # Where it may not hang, there is none, however the others stand.
    lower[0], upper[0] = 0.2, 0.5
    lower[1:], upper[1:] = here[1:] - 0.1, here[1:] + 0.1
    assert balanced_pose(model, 0, np.clip(here, lower, upper), lower, upper, 0.01) is None


class Pendulum:
    """One link that hangs at 0."""

    n = 1

    def gravity(self, q: np.ndarray) -> np.ndarray:
        return np.sin(q)


def test_a_link_that_hangs_is_better_than_one_that_would_fall_over():
    ends = np.array([-1.0]), np.array([4.0])
    found = balanced_pose(cast(Model, Pendulum()), 0, np.array([2.2]), *ends, 0.01)
    assert found == pytest.approx([0.0], abs=0.01)
    ends = np.array([1.0]), np.array([4.0])
    found = balanced_pose(cast(Model, Pendulum()), 0, np.array([2.2]), *ends, 0.01)
    assert found == pytest.approx([np.pi], abs=0.01)


def test_a_joint_that_carries_nothing_stays_where_it_is():
    robot = load_robot(ROMEO)
    c = robot.configuration
    model = Model(robot.urdf, c.joint_names)
    n = len(c.joints)
    here = np.zeros(n)
    heavy = float(np.abs([model.gravity(row)[0] for row in np.eye(n)]).max())
    found = balanced_pose(model, 0, here, np.full(n, -0.5), np.full(n, 0.5), 10.0 * heavy)
    assert found is not None
    np.testing.assert_array_equal(found, here)


def test_strokes_are_distinguished_from_a_hand_and_from_fast_motion(handled, moved):
    assert stroking(stroke_log(0.06, 0.03, 1.0).motor_velocity[:, 0])
    for log in (handled[0], moved.filtered[0]):
        assert not any(stroking(log.motor_velocity[:, i]) for i in range(log.n))


@pytest.mark.parametrize("friction", [0.35, 1.2])
def test_a_link_that_falls_through_its_gap_is_not_carried_there(friction):
    """Its motor is hardly seen inside the gap, so that its friction is not known: what seems to be
    load beyond it, while the link falls, is none. As it lets its link down, too, that friction is
    distinguished from alpha."""
    t = np.arange(0.0, 5 * 5.0, 0.01)
    direction = np.where(t // 5.0 % 2.0 < 1.0, 1.0, -1.0)
    theta_dot = 0.016 * direction
    theta = np.cumsum(theta_dot) * 0.01 - 0.04
    alpha, ahead = 0.006, direction * theta  # of the balance, beyond which the link falls
    load = -4.0 * theta + 0.02 * direction
    fallen = np.clip((ahead - 0.005) / 0.016 / 0.25, 0.0, 1.0)
    falls = (fallen > 0.0) & (fallen < 1.0)
    phi = alpha * direction * (2.0 * fallen**3 - 1.0) - 0.0008 * np.where(falls, 0.0, load)
    torque = np.where(falls, 0.0, load) + friction * direction
    torque += 0.003 * np.random.default_rng(1).standard_normal(len(t))
    found = from_strokes("j", t, theta + phi, theta, theta_dot, torque)
    assert found.verdict is GapVerdict.CLEAR, found.reason
    assert found.half_gap == pytest.approx(alpha, abs=found.confidence)
    assert found.confidence < 0.0003


def slow_strokes(
    alpha: float,
    *,
    T: float = 0.01,
    gear: float = 1000.0,
    link: float = 0.5,
    strokes: int = 4,
    warms: float = 0.0,
) -> tuple[np.ndarray, ...]:
    """Time, positions of link and motor, velocity and torque of strokes at 15 mrad/s of a joint
    without inertia: friction of 1 Nm at the motor, which `warms` away by a share until the end, and
    of `link` [Nm] at the link."""
    rng, way, speed = np.random.default_rng(0), 2.0 * alpha + 0.06, 0.015
    corners = 0.5 * way * np.array([0.0, *np.resize([-1.0, 1.0], strokes), 0.0])
    at = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)))]) / speed
    t = np.arange(0.0, at[-1], T)
    theta, q, q_now = np.interp(t, at, corners), np.zeros_like(t), 0.0
    reach = alpha + link / gear
    for k, motor in enumerate(theta.tolist()):
        q_now = min(max(q_now, motor - reach), motor + reach)
        q[k] = q_now
    velocity, apart = np.gradient(theta, t), theta - q
    torque = gear * (apart - np.clip(apart, -alpha, alpha))
    torque += (1.0 - warms * t / t[-1]) * np.tanh(velocity / 0.002)
    return t, q, theta, velocity, torque + 0.02 * rng.standard_normal(len(t))


def test_strokes_of_a_motor_that_turns_unevenly_are_known_to_be_strokes():
    """As at a light wrist, whose link swings: by the motion alone a hand may have been there."""
    t, q, theta, velocity, torque = slow_strokes(0.01)
    uneven = velocity * (1.0 - 0.6 * (np.sin(2.0 * t) > 0.6))
    log = MotionLog(("j",), t, *(x[:, None] for x in (torque, q, uneven, theta)))
    assert not stroking(uneven)
    assert not identify_gap(log, 0, 1.0).usable
    found = identify_gap(log, 0, 1.0, stroked=True)
    assert found.verdict is GapVerdict.CLEAR, found
    assert found.half_gap == pytest.approx(0.01, abs=found.confidence)


@pytest.mark.parametrize("alpha", [0.002, 0.01])
@pytest.mark.parametrize("offset", [-0.5, 0.2, 2.0])
def test_an_offset_of_the_current_changes_nothing(alpha, offset):
    *moved, torque = slow_strokes(alpha)
    found = from_strokes("j", *moved, torque + offset)
    assert found.verdict is GapVerdict.CLEAR, found
    assert found.half_gap == pytest.approx(alpha, abs=found.confidence)
    assert found.half_gap == pytest.approx(alpha, abs=1e-4)


@pytest.mark.parametrize("alpha", [0.01, 0.04])
@pytest.mark.parametrize("warms", [-0.3, 0.3])
def test_a_motor_that_warms_hides_nothing_of_what_a_soft_gear_bends(alpha, warms):
    found = from_strokes("j", *slow_strokes(alpha, gear=350.0, strokes=10, warms=warms))
    assert found.verdict is GapVerdict.CLEAR, found
    assert abs(found.half_gap - alpha) < found.confidence, found


@pytest.mark.parametrize("alpha", [0.0, 0.005, 0.02, 0.08])
@pytest.mark.parametrize(
    "spoil",
    [
        {"step": 0.002}, {"step": 2.0 * np.pi / 4096.0}, {"late": 0.05}, {"T": 0.06}, {"T": 0.1},
        {"turned": 0.0}, {"turned": -1.0}, {"turned": 0.0, "gear": 300.0, "link": 3.0},
        {"turned": -1.0, "gear": 300.0, "link": 3.0},
    ],
    ids=str,
)  # fmt: skip
def test_what_spoils_a_log_makes_the_interval_wider_or_is_refused(alpha, spoil):
    """Encoders of coarse steps, a current that comes late, slow logs, no current, one of the other
    sign: what the gear bends is taken for gap, and no scatter shows it."""
    wrong = {"step": 0.0, "late": 0.0, "turned": 1.0}
    wrong |= {name: spoil[name] for name in wrong if name in spoil}
    plant = {name: value for name, value in spoil.items() if name not in wrong}
    t, q, theta, velocity, torque = slow_strokes(alpha, **plant)
    if wrong["step"]:
        q = wrong["step"] * np.round(q / wrong["step"])
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(t))
    torque = wrong["turned"] * np.interp(t - wrong["late"], t, torque) + noise
    found = from_strokes("j", t, q, theta, velocity, torque)
    if found.verdict is GapVerdict.CLEAR:
        assert abs(found.half_gap - alpha) < 1.5 * found.confidence, found
    elif found.verdict is GapVerdict.NONE:
        assert alpha == 0.0, found
    if wrong["turned"] <= 0.0:
        assert not found.usable, found


def test_a_link_that_bounces_rests_inside_its_gap_and_the_interval_says_so():
    """Owners' joints with scatter beyond 0.2 mrad came out too small, by up to that scatter."""
    still = StrokeFit(
        alpha=0.007, compliance=0.0, bent=0.0, error=5e-5, scatter=0.0, rarer=0.5, harmonics=(),
        coulomb=0.1, bending_error=0.0, hidden=6e-5, noise=0.0,
    )  # fmt: skip
    calm, bounces = (
        _judged("forearm", replace(still, scatter=scatter), 5, []) for scatter in (0.0, 2.4e-4)
    )
    assert calm.usable
    assert bounces.usable
    assert bounces.confidence == pytest.approx(calm.confidence + 1.2e-4)
