"""Masses and loads from motion: of an arm whose URDF is wrong, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as replace_

from bench.rigs.reaching import Reaching
from bench.study.masses import Subjects, carrying, true_bodies
from common.errors import LogError
from daemon.assembly import build_transmission
from estimator.body_inertia import BodyInertia
from estimator.model import Model
from estimator.payload import Payload
from identification.masses import Masses, MassesVerdict, identify_masses
from identification.motion_log import MotionLog
from identification.payload_fit import PayloadFit, PayloadVerdict, identify_payload

LOAD = Payload.of(0.4, [0.03, 0.02, -0.06])


@pytest.fixture(scope="module")
def subjects() -> Subjects:
    """One arm whose masses are 20 % and whose centres are 20 mm off."""
    return Subjects(1, (7, 0))


@pytest.fixture(scope="module")
def log(subjects: Subjects) -> MotionLog:
    return subjects.moved(subjects.arms, 24.0, seed=3)[0]


@pytest.fixture(scope="module")
def short(log: MotionLog) -> MotionLog:
    """Enough for what is refused."""
    return log.select(slice(0, 1000))


@pytest.fixture(scope="module")
def masses(subjects: Subjects, log: MotionLog) -> Masses:
    return identified(subjects, log)


def identified(
    subjects: Subjects, log: MotionLog, model: Model | None = None, shortest_s: float = 20.0
) -> Masses:
    c = subjects.c
    return identify_masses(
        log, model or subjects.model, build_transmission(c), c.estimator, subjects.max_current,
        subjects.limits, shortest_s,
    )  # fmt: skip


def true_model(subjects: Subjects) -> Model:
    robot = subjects.robot
    return Model(robot.urdf, subjects.c.joint_names, true_bodies(subjects.arms[0]))


def verdicts(masses: Masses) -> list[MassesVerdict]:
    return [fit.verdict for fit in masses.fits]


def test_the_residual_is_that_of_exact_masses(subjects, masses) -> None:
    """Held out, of the estimator, with friction identified by either."""
    assert masses.usable, masses
    for_friction = subjects.moved(subjects.arms, 24.0, seed=1)[0]
    tested = subjects.moved(subjects.arms, 16.0, seed=2)[0]

    def rms(bodies) -> np.ndarray:
        return subjects.residual(subjects.friction_with(bodies, for_friction), tested)

    exact = rms(true_bodies(subjects.arms[0]))
    assert (rms({fit.joint: fit.body for fit in masses.fits}) / exact).max() < 1.1
    assert (rms({}) / exact).max() > 2.0


def gravity_off(subjects: Subjects, found: Masses | None = None) -> np.ndarray:
    """By how much the gravity of bodies, the URDF's or those found, is off (n,) [Nm] in poses that
    were not seen."""
    names = subjects.c.joint_names
    bodies = {} if found is None else {f.joint: f.body for f in found.fits}
    model, true = Model(subjects.robot.urdf, names, bodies), true_model(subjects)
    poses = np.random.default_rng(0).uniform(*subjects.limits, (100, len(names)))
    return np.abs([model.gravity(q) - true.gravity(q) for q in poses]).max(axis=0)


def test_gravity_is_that_of_the_true_arm_in_poses_that_were_not_seen(subjects, masses) -> None:
    assert (gravity_off(subjects, masses) < 0.05 * gravity_off(subjects)).all()


def test_coarse_encoders_make_no_inertia_smaller_nor_a_mass_larger(subjects) -> None:
    """By 14 bits the regressor's own noise had been a share of its square."""
    moved = subjects.moved(subjects.arms, 24.0, seed=3)[0]
    count = 2.0 * np.pi / 2**13
    coarse = replace(moved, link_position=count * np.round(moved.link_position / count))
    found = identified(subjects, coarse)
    for fit, true in zip(found.fits, true_bodies(subjects.arms[0]).values(), strict=True):
        assert abs(fit.body.mass - true.mass) < 1.96 * fit.errors[0], fit
    off = gravity_off(subjects, found) / gravity_off(subjects)
    assert off.max() < 0.2


def test_what_is_shown_says_how_much_better_it_is(masses) -> None:
    for fit in masses.fits:
        assert fit.reason == ""
        assert fit.by_this < 0.9 * fit.by_urdf
    assert min(fit.by_this / fit.by_urdf for fit in masses.fits) < 0.1
    assert 20 < masses.determined < masses.parameters == 70
    assert masses.touched == ()


@pytest.mark.parametrize(
    ("by_urdf", "by_this", "verdict"),
    [(1.06, 1.12, MassesVerdict.WORSE), (0.00259, 0.00265, MassesVerdict.GOOD)],
)
def test_masses_that_are_worse_on_held_out_motion_are_not_good(
    subjects, short, monkeypatch: pytest.MonkeyPatch, by_urdf, by_this, verdict
) -> None:
    """One joint of a measured arm, by more than a thousandth of its friction; others better."""
    n = short.n
    before, after = np.full((2, n), 1.06), np.full((2, n), 0.5)
    before[:, 2], after[0, 2], after[1, 2] = by_urdf, by_this, 0.5 * by_urdf
    monkeypatch.setattr("identification.masses._held_out", lambda *_: (before, after))
    found = identified(subjects, short, shortest_s=10.0)
    assert found.usable is (verdict is MassesVerdict.GOOD)
    assert found.fits[2].verdict is verdict


@pytest.mark.parametrize(
    ("share", "verdict"), [(0.8, MassesVerdict.AS_GOOD), (0.4, MassesVerdict.GOOD)]
)
def test_the_urdf_stays_where_intervals_hold_it_and_little_is_better(
    subjects, short, monkeypatch: pytest.MonkeyPatch, share, verdict
) -> None:
    before = np.ones((2, short.n))
    monkeypatch.setattr("identification.masses._held_out", lambda *_: (before, share * before))
    found = identified(subjects, short, true_model(subjects), shortest_s=10.0)
    assert set(verdicts(found)) == {verdict}


@pytest.mark.parametrize("wobble", [0.0, 0.0015])
def test_intervals_hold_true_bodies(subjects, log, wobble) -> None:
    """Also by encoders that are eccentric, of which the model knows nothing."""
    q = log.link_position
    found = identified(subjects, replace(log, link_position=q + wobble * np.cos(3.0 * q)))
    true = true_model(subjects).parameters()
    bodies = {fit.joint: fit.body for fit in found.fits}
    by_this = Model(subjects.robot.urdf, subjects.c.joint_names, bodies).parameters()
    off = np.abs(by_this - true) / (1.96 * np.array([fit.errors for fit in found.fits]))
    assert (off < 1.0).mean() > 0.95, off
    assert off.max() < 2.0, (np.argwhere(off > 1.0), off[off > 1.0])
    errors, mass = found.fits[1].errors, subjects.model.parameters()[1, 0]
    assert errors[0] > 0.1 * mass  # no motion of a shoulder shows its mass
    assert errors[1:4].min() < 0.05 * mass


def test_right_masses_stay(subjects, log) -> None:
    again = identified(subjects, log, true_model(subjects))
    assert not again.usable
    assert set(verdicts(again)) == {MassesVerdict.AS_GOOD}


def test_a_short_log_is_refused(subjects, log) -> None:
    with pytest.raises(LogError, match=r"too short: 15\.0 s, at least 20 s of motion"):
        identified(subjects, log.select(slice(0, 1500)))
    assert identified(subjects, log.select(slice(0, 1500)), shortest_s=10.0).usable


@pytest.mark.parametrize("share", [-1.0, 0.0, 0.1])
def test_a_current_that_carries_no_such_arm_makes_no_masses(subjects, short, share) -> None:
    """Currents of the other sign, not logged, or of another unit: bodies fit them as well."""
    found = identified(subjects, replace(short, current=share * short.current), shortest_s=10.0)
    assert not found.usable
    wrong = [fit for fit in found.fits if fit.verdict is MassesVerdict.WRONG_GRAVITY]
    assert wrong
    assert all("sign and unit of the current" in fit.reason for fit in wrong)


def test_a_joint_that_carries_nothing_by_its_urdf_shows_of_no_current(subjects, short) -> None:
    """Its last body has its centre on the axis: any gravity is many times none."""
    *_, last = subjects.c.joint_names
    body = BodyInertia.of(subjects.model.parameters()[-1])
    centred = {last: replace_(body, com=(0.0, body.com[1], 0.0))}
    model = Model(subjects.robot.urdf, subjects.c.joint_names, centred)
    found = identified(subjects, short, model, shortest_s=10.0)
    assert MassesVerdict.WRONG_GRAVITY not in verdicts(found)


def test_link_encoders_that_are_late_make_no_other_masses(subjects, log) -> None:
    late_s = 0.006
    late = log.time_s - late_s
    positions = [np.interp(late, log.time_s, q) for q in log.link_position.T]
    found = identified(subjects, replace(log, link_position=np.stack(positions, axis=1)))
    shown = found.late[np.abs(found.late) > 1e-4]
    assert len(shown) >= 3
    assert shown == pytest.approx(np.full(len(shown), late_s), abs=0.0005)
    assert (gravity_off(subjects, found) < 0.25 * gravity_off(subjects)).all()


def test_a_current_that_is_off_all_the_time_is_no_gravity(subjects, log) -> None:
    off = -0.03 * subjects.max_current * (np.arange(7) == 1)
    found = identified(subjects, replace(log, current=log.current + off))
    assert found.usable
    expected = off[1] * subjects.c.joints[1].torque_constant
    assert found.offset[1] == pytest.approx(expected, rel=0.1)
    assert np.abs(np.delete(found.offset, 1)).max() < 0.1 * abs(expected)
    assert (gravity_off(subjects, found) < 0.25 * gravity_off(subjects)).all()


def standing(log: MotionLog, joints: list[int]) -> MotionLog:
    """The log, in which these joints stood at their first position."""
    changed = {}
    for name in ("current", "link_position", "motor_velocity", "motor_position"):
        values = getattr(log, name).copy()
        values[:, joints] = 0.0 if name == "motor_velocity" else values[0, joints]
        changed[name] = values
    return replace(log, **changed)


@pytest.mark.parametrize("joints", [[4], [1, 2, 3, 4, 5, 6]])
def test_a_joint_that_stands_is_named_and_no_mass_is_used(subjects, short, joints) -> None:
    found = identified(subjects, standing(short, joints), shortest_s=10.0)
    assert not found.usable
    for i in joints:
        assert found.fits[i].verdict is MassesVerdict.NOT_EXCITED
        assert "0 reversals" in found.fits[i].reason


def test_a_motion_to_and_fro_about_one_pose_does_not_tell_gravity(subjects, short) -> None:
    """Every joint moves and turns, but the arm hardly changes its pose."""
    middle = short.link_position.mean(axis=0)
    squeezed = replace(
        short,
        link_position=middle + 0.02 * (short.link_position - middle),
        motor_position=middle + 0.02 * (short.motor_position - middle),
    )
    found = identified(subjects, squeezed, shortest_s=10.0)
    assert not found.usable


def test_a_touch_is_found_and_left_out(subjects, log, masses) -> None:
    touched = log.current.copy()
    touched[900:1000, 2] += 6.0 / subjects.c.joints[2].torque_constant
    found = identified(subjects, replace(log, current=touched))
    assert "LElbowRoll" in found.touched
    assert 0.9 < found.discarded_s < 4.0
    assert found.usable
    for fit, before in zip(found.fits, masses.fits, strict=True):
        assert fit.body.mass == pytest.approx(before.body.mass, rel=0.05)


# --- loads ----------------------------------------------------------------------------------------


def weighed(subjects: Subjects, log: MotionLog, model: Model, unsure: float = 0.01) -> PayloadFit:
    c = subjects.c
    return identify_payload(
        log, model, build_transmission(c), c.estimator, subjects.max_current, unsure
    )


@pytest.fixture(scope="module")
def carried(subjects: Subjects) -> MotionLog:
    arm = carrying(subjects.arms[0], subjects.model, LOAD)
    return subjects.moved([arm], 10.0, 4, 10.0, 10.0)[0]


def test_ten_seconds_tell_mass_and_centre_of_a_load(subjects, carried) -> None:
    fit = weighed(subjects, carried, true_model(subjects))
    assert fit.verdict is PayloadVerdict.GOOD, fit
    assert fit.mass == pytest.approx(LOAD.mass, rel=0.01)
    assert fit.com == pytest.approx(np.array(LOAD.com), abs=0.001)
    assert fit.mass_error < 0.01
    assert fit.com_error < 0.003


@pytest.mark.parametrize("seed", range(2))
def test_an_arm_whose_masses_may_be_off_widens_the_errors_by_as_much(
    subjects, carried, seed
) -> None:
    """Bodies some per cent off, and torque constants 2 %."""
    rng, true = np.random.default_rng(seed), true_bodies(subjects.arms[0])
    off = {
        name: replace_(body, mass=body.mass * (1.0 + 0.04 * rng.choice((-1.0, 1.0))))
        for name, body in true.items()
    }
    model = Model(subjects.robot.urdf, subjects.c.joint_names, off)
    current = carried.current * (1.0 + 0.02 * rng.choice((-1.0, 1.0), 7))
    fit = weighed(subjects, replace(carried, current=current), model, 0.05)
    sure = weighed(subjects, carried, true_model(subjects))
    assert fit.mass_error > 2.0 * sure.mass_error
    assert abs(fit.mass - LOAD.mass) < 3.0 * fit.mass_error, fit
    assert np.linalg.norm(fit.com - np.array(LOAD.com)) < 3.0 * fit.com_error, fit


@pytest.mark.parametrize(
    ("change", "verdict", "says"),
    [
        (lambda log: log, PayloadVerdict.NOTHING, "the hand is empty"),
        (lambda log: standing(log, list(range(7))), PayloadVerdict.NOT_EXCITED, "hardly moved"),
        (
            lambda log: standing(log, [0, 1, 3, 4, 5, 6]),
            PayloadVerdict.NOT_EXCITED,
            "cannot separate mass and place of a load",
        ),
    ],
)
def test_what_shows_no_load_is_refused(subjects, change, verdict, says) -> None:
    empty = subjects.moved(subjects.arms, 10.0, 4, 10.0, 10.0)[0]
    fit = weighed(subjects, change(empty), true_model(subjects))
    assert fit.verdict is verdict, fit
    assert says in fit.reason


def test_an_arm_lighter_than_its_model_is_no_load(subjects) -> None:
    """With the load in the model, and none in the hand."""
    true = true_bodies(subjects.arms[0])
    loaded = true | true_bodies(carrying(subjects.arms[0], subjects.model, LOAD))
    model = Model(subjects.robot.urdf, subjects.c.joint_names, loaded)
    empty = subjects.moved(subjects.arms, 10.0, 4, 10.0, 10.0)[0]
    fit = weighed(subjects, empty, model)
    assert fit.verdict is PayloadVerdict.NOT_EXCITED
    assert "lighter than its model" in fit.reason


# --- drives that do not ramp from setpoint to setpoint --------------------------------------------


@pytest.mark.parametrize(
    "reaching",
    [
        Reaching(way="steps", bandwidth_Hz=40.0),
        Reaching(way="accelerates", bandwidth_Hz=40.0, acceleration=60.0),
    ],
    ids=str,
)
def test_the_rotors_take_what_currents_miss_and_bodies_and_loads_stay_true(reaching) -> None:
    """A fifth to two thirds of the current for acceleration is missing."""
    subjects = Subjects(1, (7, 0), reaching)
    masses = identified(subjects, subjects.moved(subjects.arms, 24.0, seed=3)[0])
    assert masses.usable, masses
    bodies = {fit.joint: fit.body for fit in masses.fits}
    found = Model(subjects.robot.urdf, subjects.c.joint_names, bodies)
    true, rng = true_model(subjects), np.random.default_rng(0)
    poses = rng.uniform(*subjects.limits, (50, true.n))
    for what in (Model.gravity, Model.inertia):
        exact, by_this, by_urdf = (
            np.array([what(model, q) for q in poses]) for model in (true, found, subjects.model)
        )
        off, before = np.abs(by_this - exact).mean(axis=0), np.abs(by_urdf - exact).mean(axis=0)
        assert (off < 0.05 * np.abs(exact).mean(axis=0) + 0.05 * before).all(), what.__name__
    arm = carrying(subjects.arms[0], subjects.model, LOAD)
    fit = weighed(subjects, subjects.moved([arm], 10.0, 4, 10.0, 10.0)[0], found)
    assert fit.verdict is PayloadVerdict.GOOD, fit
    assert abs(fit.mass - LOAD.mass) < 3.0 * fit.mass_error, fit
    assert np.linalg.norm(fit.com - np.array(LOAD.com)) < 3.0 * fit.com_error, fit


def test_a_look_at_a_load_that_is_too_short_is_refused(subjects, carried) -> None:
    with pytest.raises(LogError, match=r"too short: 5\.0 s, at least 8 s"):
        weighed(subjects, carried.select(slice(0, 500)), subjects.model)
