"""Friction that grows with the load, of arms whose gears are not the model's."""

from dataclasses import replace

import numpy as np
import pytest

from bench.rigs.arm_without_bus import Course, Scenario, Subject, record
from identification import regression
from identification.excitation import fourier_within, trajectory
from identification.friction import identify_friction
from identification.friction_fit import FrictionFit, adopt
from identification.friction_verdict import Verdict
from identification.motion_log import MotionLog
from simulator.description import Mismatch, SimulationSettings
from simulator.gear_settings import GearSettings
from simulator.mismatch import PlantParameters, true_parameters

SECONDS, TICK_S = 16.0, 0.01


@pytest.fixture(scope="session")
def course(arm) -> Course:
    motion = fourier_within(arm.bounds.shrunk(0.7), arm.model, np.random.default_rng(1))
    begin = motion.at(np.zeros(1))[0][0]
    path = trajectory(motion, begin, arm.bounds, SECONDS, TICK_S)
    return Course(path, np.gradient(path, TICK_S, axis=0))


OFF = Mismatch(
    mass=3, center_of_mass=0, friction=20, torque_constant=1, half_gap=0, rotor_inertia=5
)


def geared(gears: GearSettings) -> SimulationSettings:
    return SimulationSettings(seed=3, mismatch=OFF, gears=gears)


def identified(
    arm, course: Course, settings: SimulationSettings
) -> tuple[list[FrictionFit], PlantParameters]:
    """Fits, and the true arm."""
    recording = record(
        Subject(robot=arm.robot, settings=settings), Scenario(seconds=SECONDS, motion=course)
    )
    columns = np.moveaxis(recording.samples, 1, 0)
    log = MotionLog(tuple(arm.configuration.joint_names), recording.time_s, *columns)
    true = true_parameters(arm.description, settings)
    known = replace(arm.transmission, half_gap=true.half_gap)
    fits, _ = identify_friction(log, arm.model, known, arm.configuration.estimator, arm.max_current)
    return fits, true


@pytest.mark.parametrize(("driving", "driven"), [(0.1, 0.1), (0.2, 0.25)])
def test_friction_per_load_is_found_beside_that_without(arm, course, driving, driven) -> None:
    gears = GearSettings(load_driving=driving, load_driven=driven)
    fits, arms = identified(arm, course, geared(gears))
    coulomb = arms.coulomb.reshape(2, -1).sum(axis=0)
    assert [fit.verdict for fit in fits] == [Verdict.GOOD] * 7, fits
    for fit, true in zip(fits, coulomb, strict=True):
        assert fit.load is not None, fit
        assert fit.load[0] <= 0.5 * (driving + driven) <= fit.load[1], fit
        assert fit.load[1] - fit.load[0] < 0.5 * driven
        assert fit.values["K_theta_s"] == pytest.approx(true, rel=0.08), fit
    adopted = adopt(arm.transmission, fits)
    assert adopted.load_friction == pytest.approx(0.5 * (driving + driven), rel=0.25)
    assert (adopted.load_friction_error >= 0.005).all()


@pytest.mark.parametrize(("driving", "driven"), [(0.005, 0.005), (0.01, 0.02)])
def test_a_share_that_does_not_show_is_within_its_bound(arm, course, driving, driven) -> None:
    gears = GearSettings(load_driving=driving, load_driven=driven)
    fits, _ = identified(arm, course, geared(gears))
    hidden = [fit for fit in fits if fit.load is None]
    assert hidden
    assert all(0.5 * (driving + driven) <= 1.05 * fit.load_bound for fit in hidden), hidden


def test_friction_that_no_load_changes_has_no_share_of_it(arm, course) -> None:
    fits, _ = identified(arm, course, geared(GearSettings()))
    assert [fit.load for fit in fits] == [None] * 7
    assert all(0.0 <= fit.load_bound < 0.05 for fit in fits)
    adopted = adopt(replace(arm.transmission, load_friction=0.1, load_friction_error=0.1), fits)
    assert not adopted.load_friction.any(), "its mean is in the Coulomb friction"
    assert not adopted.load_friction_error.any()


@pytest.mark.parametrize("rise", [1.15, 1.3])
def test_friction_that_falls_with_speed_is_within_the_interval(arm, course, rise) -> None:
    settings = SimulationSettings(
        friction="dahl", presliding=0.001, stribeck=rise, seed=3, mismatch=OFF
    )
    fits, true = identified(arm, course, settings)
    viscous = true.viscous.reshape(2, -1).sum(axis=0)
    off = np.abs([fit.values["K_theta_v"] for fit in fits] - viscous)
    assert (off / viscous).max() > 0.1
    assert (off < [fit.half_interval("K_theta_v") for fit in fits]).all()


def test_friction_that_ripples_is_averaged_within_the_interval(arm, course) -> None:
    """Friction by 20 % twice a turn of motor and joint, and motors that cog with 1 %."""
    gears = GearSettings(friction_ripple=20.0, cogging=1.0)
    within = []
    for seed in (3, 4, 5):
        settings = SimulationSettings(seed=seed, mismatch=OFF, gears=gears)
        fits, true = identified(arm, course, settings)
        for name, of in (("K_theta_s", true.coulomb), ("K_theta_v", true.viscous)):
            off = np.abs([fit.values[name] for fit in fits] - of.reshape(2, -1).sum(axis=0))
            within += (off < [fit.half_interval(name) for fit in fits]).tolist()
    assert np.mean(within) >= 0.95


def test_a_joint_that_gravity_hardly_loads_shows_no_share(arm, course, monkeypatch) -> None:
    """Its acceleration looks alike: an upright base was good at 2.5 intervals."""
    monkeypatch.setattr(regression, "_LOADED", 0.6)
    fits, _ = identified(arm, course, geared(GearSettings(load_driving=0.2, load_driven=0.25)))
    shown = {fit.joint for fit in fits if fit.load is not None}
    assert set() < shown < set(arm.configuration.joint_names)
