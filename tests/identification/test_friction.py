"""Friction and rotor inertia of arms that are not quite the configured one."""

import math
import re
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from bench.rigs.foreign_logs import stranger
from common.errors import LogError
from daemon.assembly import build_transmission
from daemon.config.load import load_robot
from estimator.model import Model
from estimator.transmission import STICTION_ERROR
from identification.friction import identify_friction
from identification.friction_errors import constant_off, masses_off, shared
from identification.friction_fit import adopt
from identification.friction_verdict import GIVE, LOWEST_R2, WIDEST_PLAY, Verdict
from identification.motion_log import MotionLog
from identification.sticking import sticking_share


@pytest.fixture(scope="session")
def identify(arm):
    """Fits of a log; half-gaps are known already, friction and rotors are off by up to half."""

    def run(log: MotionLog, half_gap: np.ndarray, delay_ms: float = 3.0):
        settings = msgspec.structs.replace(arm.configuration.estimator, current_delay_ms=delay_ms)
        known = replace(arm.transmission, half_gap=half_gap)
        return identify_friction(log, arm.model, known, settings, arm.max_current)

    return run


@pytest.fixture(scope="session")
def fitted(moved, identify):
    return [
        identify(log, true.half_gap) for log, true in zip(moved.filtered, moved.arms, strict=True)
    ]


def errors(fits, true, name: str) -> np.ndarray:
    """Relative errors of one coefficient; friction is that of both sides together."""
    sums = {
        "K_theta_s": true.coulomb.reshape(2, -1).sum(axis=0),
        "K_theta_v": true.viscous.reshape(2, -1).sum(axis=0),
        "B": true.rotor_inertia,
    }
    return np.array([fit.values[name] for fit in fits]) / sums[name] - 1.0


@pytest.mark.parametrize("which", [0, 1])
def test_sum_of_frictions_is_found(fitted, moved, which):
    fits, _ = fitted[which]
    assert [fit.verdict for fit in fits] == [Verdict.GOOD] * 7, fits
    assert np.abs(errors(fits, moved.arms[which], "K_theta_s")).max() < 0.10
    assert np.abs(errors(fits, moved.arms[which], "K_theta_v")).max() < 0.15


@pytest.mark.parametrize("hose", [0.0, -1.0])
def test_coarse_positions_are_no_misfit_and_a_hose_is(moved, identify, arm, fitted, hose):
    """An encoder of 11 bits, and a spring of so many times the joint's friction."""
    log, known = moved.filtered[0], fitted[0][0][1].values["K_theta_s"]
    current, position = log.current.copy(), log.link_position.copy()
    way = position[:, 1] - position[:, 1].mean()
    pull = hose * known / np.abs(way).max() / arm.transmission.torque_constant[1]
    current[:, 1] += pull * way
    position[:, 1] = np.round(position[:, 1] * 2**11 / math.tau) * math.tau / 2**11
    coarse = replace(log, current=current, link_position=position)
    fit = identify(coarse, moved.arms[0].half_gap)[0][1]
    assert (fit.r2 < LOWEST_R2) is bool(hose), fit


@pytest.mark.parametrize("which", [0, 1])
def test_rotor_inertia_is_found(fitted, moved, which):
    fits, _ = fitted[which]
    assert np.abs(errors(fits, moved.arms[which], "B")).max() < 0.10
    assert all(fit.rotor_trusted for fit in fits)


def test_rotor_of_a_light_joint_that_rattles_in_its_gap(fitted, moved):
    fits, _ = fitted[0]
    assert abs(errors(fits, moved.arms[0], "B")[6]) < 0.03


def test_smooth_friction_does_not_stick(fitted, arm):
    for fits, _ in fitted:
        assert all(fit.stiction < 0.05 and fit.stiction_known for fit in fits), fits
        adopted = adopt(arm.transmission, fits)
        assert (adopted.least_stiction == 0.0).all()
        assert (adopted.most_stiction < 0.1 + STICTION_ERROR).all()


@pytest.mark.parametrize(
    ("found", "error", "least", "most"),
    [(0.6, 0.01, 0.3, 1.0), (0.2, 0.01, 0.0, 0.7), (0.6, np.inf, 0.1, 0.95)],
)
def test_what_is_adopted_of_stiction(fitted, arm, found, error, least, most):
    """A share that was found, and its error; what was known before where it was not."""
    fits = [replace(fit, stiction=found, stiction_error=error) for fit in fitted[0][0]]
    known = replace(arm.transmission, least_stiction=0.1, most_stiction=0.95)
    adopted = adopt(known, fits)
    np.testing.assert_allclose(adopted.least_stiction, least)
    np.testing.assert_allclose(adopted.most_stiction, most)


def test_friction_that_sticks_is_no_touch_and_spoils_no_coefficient(sticking, identify, arm):
    log, true = sticking
    fits, shown = identify(log, true.half_gap)
    assert [fit.verdict for fit in fits] == [Verdict.GOOD] * 7, fits
    assert shown.touched == ()
    assert np.abs(errors(fits, true, "K_theta_s")).max() < 0.05
    assert np.abs(errors(fits, true, "K_theta_v")).max() < 0.10
    assert np.abs(errors(fits, true, "B")).max() < 0.12
    assert all(fit.stiction_known for fit in fits), fits
    adopted = adopt(arm.transmission, fits)
    assert (adopted.least_stiction > 0.0).all()
    assert (adopted.most_stiction == 1.0).all()  # Dahl's friction sticks as a whole


@pytest.mark.parametrize("joint", [1, 6])
def test_link_friction_shows_in_the_gap(fitted, moved, joint):
    """Joint that carries little: the middle of its gap must be found from phi itself, and what
    impacts leave in a difference of positions is no viscous friction."""
    values, true = fitted[0][0][joint].values, moved.arms[0]
    assert values["K_q_s"] == pytest.approx(true.coulomb[joint], rel=0.25)
    assert values["K_q_v"] == pytest.approx(true.viscous[joint], rel=0.4)


def test_held_out_motion_is_explained_where_the_inertias_are_right(fitted):
    fits, shown = fitted[0]
    assert min(fit.r2 for fit in fits) > 0.98
    left = np.square(shown.r_nl - shown.reconstructed).mean(axis=0)
    assert (left < 0.1 * np.square(shown.r_nl).mean(axis=0)).all()


def test_gravity_shows_the_torque_constant_where_the_masses_are_right(fitted, moved, arm):
    """As exactly as the fit is, also of a light joint whose friction hides much of it."""
    fits, _ = fitted[0]
    off = arm.transmission.torque_constant / moved.arms[0].torque_constant
    shown = np.array([fit.gravity_scale for fit in fits])
    assert np.isfinite(shown).sum() >= 4
    assert shown[np.isfinite(shown)] == pytest.approx(off[np.isfinite(shown)], abs=0.02)


def test_masses_that_were_identified_are_believed_more(moved, identify, arm, monkeypatch):
    # Their torque constant is not seen any more: what else is believed is compared.
    monkeypatch.setattr("identification.friction_errors._CONSTANT_OFF", 0.0)
    log, true = moved.filtered[0], moved.arms[0]
    known = replace(arm.transmission, half_gap=true.half_gap)
    settings = arm.configuration.estimator
    weighed, _ = identify_friction(log, arm.model, known, settings, arm.max_current, weighed=True)
    by_urdf, _ = identify(log, true.half_gap)
    for one, other in zip(weighed, by_urdf, strict=True):
        assert one.values == other.values
        assert one.noise == other.noise
        assert one.noise["K_theta_s"] > 0.0
        assert one.noise["K_theta_s"] < one.errors["K_theta_s"] < other.errors["K_theta_s"]
        assert one.uncertainty < other.uncertainty
        assert one.seconds == pytest.approx(log.measured_s, abs=0.1)
        assert one.uncertainty == pytest.approx(
            3.92 * max(one.errors[k] / one.values[k] for k in ("K_theta_s", "K_theta_v"))
        )


@pytest.mark.parametrize(("falls", "matter"), [(0.0, True), (1e4, False)])
def test_masses_matter_unless_friction_that_falls_with_speed_does(
    moved, identify, monkeypatch, falls, matter
):
    monkeypatch.setattr("identification.friction_errors._CONSTANT_OFF", 0.0)
    monkeypatch.setattr("identification.friction_errors._BY_URDF", 0.3)
    monkeypatch.setattr("identification.friction_errors._FALLS", falls)
    fits, _ = identify(moved.filtered[0], moved.arms[0].half_gap)
    assert any(fit.masses_matter for fit in fits) is matter


def test_what_weighing_changed_is_as_little_sure(moved, arm):
    log = moved.filtered[0].select(slice(0, 1400))
    known = replace(arm.transmission, half_gap=moved.arms[0].half_gap)
    urdf = arm.description.urdf.read_text()
    heavier = re.sub(r'mass value="(\S+)"', lambda m: f'mass value="{1.3 * float(m[1])}"', urdf)

    def errors_of_rotors(text):
        before = Model(text, arm.model.names)
        fits, _ = identify_friction(log, arm.model, known, arm.configuration.estimator,
                                    arm.max_current, weighed=True, by_urdf=before)  # fmt: skip
        return np.array([fit.errors["B"] for fit in fits])

    same, changed = errors_of_rotors(urdf), errors_of_rotors(heavier)
    assert (changed[:2] > 1.5 * same[:2]).all()


@pytest.mark.parametrize(
    ("gravity", "least", "most"),
    [(math.nan, 0.03, 0.03), (1.0, 0.02, 0.022), (1.06, 0.035, 0.04), (0.8, 0.1, 0.105)],
)
def test_a_torque_constant_is_as_sure_as_data_sheets_and_gravity_make_it(gravity, least, most):
    assert least <= constant_off(gravity) <= most


@pytest.mark.parametrize(
    ("scales", "found"),
    [([], math.nan), ([0.7], math.nan), ([0.7, 1.01, 0.8], math.nan), ([0.7, 0.8, 0.6], 0.8),
     ([1.4, 1.5], 1.4)],
)  # fmt: skip
def test_joints_that_gravity_turns_say_how_far_off_the_others_are(scales, found):
    assert shared(np.array(scales)) == pytest.approx(found, nan_ok=True)


@pytest.mark.parametrize(
    ("scales", "off"),
    [([], 0.03), ([1.0, 1.02], 0.03), ([0.9, 1.1], 0.1), ([1.0, 1000.0], 0.3 / math.sqrt(2.0))],
)
def test_a_torque_in_another_unit_makes_no_mass_unsure(scales: list[float], off: float) -> None:
    assert masses_off(np.array(scales), 0.03) == pytest.approx(off)


def test_a_wrong_sign_where_gravity_turns_nothing_shows_no_error_of_masses(tmp_path) -> None:
    """It turns about the vertical: others' friction was stated to +- 100000 Nm, and good."""
    of = stranger(7, 12.0, tmp_path)
    robot, log = load_robot(tmp_path), of.log.select(slice(None, None, 5))
    log = replace(log, current=log.current * np.where(np.arange(log.n) > 0, 1.0, -1.0))
    c, most = robot.configuration, np.full(log.n, 1e3)
    first, *fits = identify_friction(log, robot.model, build_transmission(c), c.estimator, most)[0]
    assert first.verdict is not Verdict.GOOD
    assert math.isnan(first.gravity_scale)
    assert all(fit.errors["K_theta_s"] < fit.values["K_theta_s"] for fit in fits)


def test_standard_errors_are_no_decoration(fitted, moved):
    fits, _ = fitted[0]
    sums = moved.arms[0].coulomb.reshape(2, -1).sum(axis=0)
    for fit, true in zip(fits, sums, strict=True):
        assert 0.0 < fit.errors["K_theta_s"] < 0.05 * true


def test_a_touch_at_a_reversal_is_no_friction_that_sticks(moved, identify, arm):
    """Half a second of 4 Nm that the motor gives and nothing moves by, as if a hand held against it
    just where the joint turns round."""
    log, true = moved.filtered[0].select(slice(0, 1700)), moved.arms[0]
    calm, _ = identify(log, true.half_gap)
    turns = 500 + np.flatnonzero(np.diff(np.sign(log.motor_velocity[500:1500, 0])))[0]
    current = log.current.copy()
    current[turns - 25 : turns + 25, 0] -= 4.0 / arm.transmission.torque_constant[0]
    touched, shown = identify(replace(log, current=current), true.half_gap)
    assert shown.touched == ("LShoulderPitch",)
    assert touched[0].stiction == pytest.approx(calm[0].stiction, abs=0.02)
    assert touched[0].values["K_theta_s"] == pytest.approx(calm[0].values["K_theta_s"], rel=0.01)
    assert touched[0].values["B"] == pytest.approx(calm[0].values["B"], rel=0.02)


def test_what_is_wrong_is_named_and_keeps_its_values(moved, identify, arm):
    log, true = moved.filtered[0], moved.arms[0]
    doubled, standing, cut = np.arange(7) == 0, np.arange(7) == 2, np.arange(7) == 4
    limit = 0.3 * np.abs(log.current).max(axis=0)
    strained = np.where(cut, np.clip(log.current, -limit, limit), log.current)
    spoilt = replace(
        log,
        current=np.where(doubled, 2.0, 1.0) * strained,
        motor_velocity=np.where(standing, 0.0, log.motor_velocity),
        link_position=np.where(standing, 0.1, log.link_position),
        motor_position=np.where(standing, 0.1, log.motor_position),
    ).select(slice(0, 1400))
    settings = arm.configuration.estimator
    known = replace(arm.transmission, half_gap=true.half_gap)
    most = np.where(cut, limit, arm.max_current)
    fits, _ = identify_friction(spoilt, arm.model, known, settings, most)
    assert fits[0].verdict is Verdict.WRONG_GRAVITY, fits[0]
    assert 1.7 < fits[0].gravity_scale < 2.3  # joint 2 is elsewhere in truth
    assert fits[2].verdict is Verdict.NOT_EXCITED, fits[2]
    assert fits[4].verdict is Verdict.SATURATED, fits[4]
    assert all(fits[i].reason for i in (0, 2, 4))
    assert fits[1].verdict is Verdict.GOOD, fits[1]
    adopted = adopt(arm.transmission, fits)
    kept = adopted.motor_coulomb == arm.transmission.motor_coulomb
    assert kept[[0, 2, 4]].all()
    assert not kept[1]


def test_rotor_of_unfiltered_current_is_not_trusted(moved, identify, arm):
    fits, _ = identify(
        moved.unfiltered[0].select(slice(0, 1400)), moved.arms[0].half_gap, delay_ms=0.0
    )
    assert not any(fit.rotor_trusted for fit in fits)
    adopted = adopt(arm.transmission, fits)
    assert (adopted.rotor_inertia == arm.transmission.rotor_inertia).all()
    assert np.abs(errors(fits, moved.arms[0], "K_theta_s")).max() < 0.10


@pytest.mark.parametrize(("true", "found"), [(-0.5, 0.0), (0.4, 0.4), (1.5, 1.0)])
def test_from_nothing_to_all_of_friction_may_stick(true, found):
    t = np.arange(0.0, 8.0, 0.01)
    held = np.sin(t)
    share, error = sticking_share(true * held, held, np.ones_like(t), t)
    assert share == pytest.approx(found)
    assert error < 1e-6


def test_the_rotor_gets_what_the_link_does_not(fitted, arm):
    """The link gets what the gap showed, else its old share: a tenth, roughly."""
    fits, _ = fitted[0]
    old, adopted = arm.transmission, adopt(arm.transmission, fits)
    shown = [fit.link_friction("K_q_s") for fit in fits]
    assert shown[1] is not None
    assert shown[0] is None
    for i, fit in enumerate(fits):
        share = old.link_coulomb[i] / (old.link_coulomb[i] + old.motor_coulomb[i])
        link = share * fit.values["K_theta_s"] if shown[i] is None else shown[i]
        assert adopted.link_coulomb[i] == pytest.approx(link)
        assert adopted.engaged_coulomb[i] == pytest.approx(fit.values["K_theta_s"])
        engaged_viscous = adopted.motor_viscous[i] + adopted.link_viscous[i]
        assert engaged_viscous == pytest.approx(fit.values["K_theta_v"])
        assert adopted.motor_coulomb[i] > adopted.link_coulomb[i]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda log: log.select(slice(0, 500)), "too short"),
        (lambda log: log.select(slice(0, 50)), "too short"),
        (lambda log: replace(log, current=log.current * np.nan), "of LShoulderPitch is nan"),
        (lambda log: replace(log, time_s=np.zeros_like(log.time_s)), "time does not grow"),
        (lambda log: replace(log, current=log.current[:, :3]), "shape"),
    ],
)
def test_a_log_that_is_none_is_refused(moved, identify, change, says):
    with pytest.raises(LogError, match=says):
        identify(change(moved.filtered[0]), moved.arms[0].half_gap)


def test_missing_samples_only_cost_themselves(moved, identify):
    log, true = moved.filtered[0].select(slice(0, 1700)), moved.arms[0]
    keep = np.ones(len(log.time_s), dtype=bool)
    keep[700:760] = keep[820:823] = keep[1500:1503] = False  # 60 samples alone, too
    names = set(MotionLog.__dataclass_fields__) - {"joints"}
    cut = replace(log, **{name: getattr(log, name)[keep] for name in names})
    assert len(cut.stretches()) == 4
    fits, _ = identify(cut, true.half_gap)
    assert np.abs(errors(fits, true, "K_theta_s")).max() < 0.10


@pytest.mark.parametrize(("share", "wider"), [(0.0, [1, 3, 6]), (0.5, [1, 3, 6]), (0.9, [])])
def test_a_gap_that_is_wider_than_was_found_is_named(moved, identify, share, wider):
    """A hand that stops short of a border makes a half-gap too small; joint 0 and 2 never left one
    border in this motion."""
    log, true = moved.filtered[1], moved.arms[1]
    fits, _ = identify(log, share * true.half_gap)
    assert [i for i, fit in enumerate(fits) if fit.verdict is Verdict.WRONG_GAP] == wider
    for i in wider:
        assert "identify the gap again" in fits[i].reason


def test_a_gear_that_winds_up_is_not_taken_for_a_wider_gap(arm, wound_up):
    """Links eight times as heavy, on gears of 400 Nm/rad."""
    log, model, known = wound_up
    settings = arm.configuration.estimator
    fits, _ = identify_friction(log, model, known, settings, 10.0 * arm.max_current)
    # That much link and motor moved against each other beyond what any gap explains.
    apart = log.link_position[:, 0] - log.motor_position[:, 0]
    assert np.ptp(np.percentile(apart, [2.0, 98.0])) > WIDEST_PLAY * known.half_gap[0] + GIVE
    assert [fit.joint for fit in fits if fit.verdict is Verdict.WRONG_GAP] == []
    # A gap that really is wider than was found shows all the same.
    narrow = replace(known, half_gap=0.3 * known.half_gap)
    fits, _ = identify_friction(log, model, narrow, settings, 10.0 * arm.max_current)
    assert fits[1].verdict is Verdict.WRONG_GAP


def test_no_spring_of_a_gear_hides_a_wrong_torque_constant(arm, moved):
    """It bends by what gravity is, and explains what the constant does not."""
    log, true = moved.filtered[0], moved.arms[0]
    wrong = replace(
        arm.transmission, half_gap=true.half_gap, torque_constant=1.6 * true.torque_constant
    )
    fits, _ = identify_friction(
        log, arm.model, wrong, arm.configuration.estimator, 10.0 * arm.max_current
    )
    assert [fit.verdict for fit in fits] == [Verdict.WRONG_GRAVITY] * 7, fits
    for fit in fits:
        assert fit.gravity_scale == pytest.approx(1.6, rel=0.06), fit


def test_a_current_that_is_off_all_the_time_is_reported_and_spoils_no_friction(
    moved, identify, arm
):
    """By 3 % of the range."""
    log, true = moved.filtered[0], moved.arms[0]
    off = 0.03 * arm.max_current * (np.arange(7) < 3)
    fits, _ = identify(replace(log, current=log.current + off), true.half_gap)
    assert [fit.verdict for fit in fits] == [Verdict.GOOD] * 7, fits
    assert np.abs(errors(fits, true, "K_theta_s")).max() < 0.10
    shown = np.array([fit.offset for fit in fits])
    assert shown == pytest.approx(off * arm.transmission.torque_constant, rel=0.1, abs=0.01)


def test_a_rotor_that_comes_out_as_nothing_is_not_taken(moved, identify):
    """Currents that were logged 80 ms late."""
    log, true = moved.filtered[0], moved.arms[0]
    late = np.concatenate([np.repeat(log.current[:1], 8, axis=0), log.current[:-8]])
    fits, _ = identify(replace(log, current=late), true.half_gap)
    nothing = [fit for fit in fits if fit.values["B"] <= fit.noise["B"]]
    assert nothing
    assert all("came out as zero" in fit.rotor_doubt for fit in nothing)


def test_motors_that_turn_each_others_joints_are_found(moved, identify):
    """As a coupled wrist does: what rubs as the sum of two joints turns loads both."""
    log, true = moved.filtered[0], moved.arms[0]
    both = np.tanh((log.motor_velocity[:, 4] + log.motor_velocity[:, 5]) / 0.02)
    current = log.current.copy()
    rubs = 0.4 * true.coulomb.reshape(2, -1).sum(axis=0)[5]
    for i in (4, 5):
        current[:, i] += rubs / true.torque_constant[i] * both
    fits, _ = identify(replace(log, current=current), true.half_gap)
    assert [fit.verdict for fit in fits[:4]] == [Verdict.GOOD] * 4
    assert [fit.verdict for fit in fits[4:6]] == [Verdict.COUPLED] * 2
    assert "follows the motion of LWristYaw" in fits[4].reason


def test_what_is_stated_holds_with_a_torque_constant_a_quarter_off(moved, arm):
    """Everything goes with it, and gravity shows that it may be."""
    log, true = moved.filtered[0], moved.arms[0]
    wrong = replace(
        arm.transmission, half_gap=true.half_gap, torque_constant=1.22 * true.torque_constant
    )
    settings, most = arm.configuration.estimator, 10.0 * arm.max_current
    fits, _ = identify_friction(log, arm.model, wrong, settings, most)
    good = [fit for fit in fits if fit.verdict is Verdict.GOOD and np.isfinite(fit.gravity_scale)]
    assert len(good) >= 3
    for fit in good:
        i = fits.index(fit)
        off = abs(fit.values["K_theta_s"] - true.coulomb.reshape(2, -1).sum(axis=0)[i])
        assert off < 1.5 * 1.96 * fit.errors["K_theta_s"], fit


def test_what_is_stated_holds_with_wrong_masses_and_torque_constants(fitted, moved):
    """Every truth lies within one and a half of its interval of 95 %."""
    for (fits, _), true in zip(fitted, moved.arms, strict=True):
        for name in ("K_theta_s", "K_theta_v", "B"):
            stated = np.array([1.96 * fit.errors[name] / fit.values[name] for fit in fits])
            assert (np.abs(errors(fits, true, name)) < 1.5 * stated).all(), name
            assert (stated > 0.029).all()  # no torque constant is known better
