"""Arm without a bus against the arm on the bus; its truth and its timing."""

from dataclasses import replace

import numpy as np
import pytest

from bench.rigs.arm_without_bus import (
    Harness,
    Motion,
    Push,
    Recording,
    Scenario,
    Subject,
    record,
    recordings,
)
from bench.rigs.lockstep import ROMEO, lockstep_rig
from daemon.config.load import Robot, load_robot
from daemon.modes.table import Event
from programs.simulate.simulated_robot import read_simulation
from simulator.description import Mismatch, SimulationSettings


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(ROMEO)


def test_same_setpoints_give_the_same_samples_as_on_the_bus(robot: Robot) -> None:
    """From power-on, over switching on and moving: bit for bit."""
    rows = []
    with lockstep_rig() as rig:

        def each() -> None:
            samples, decision = rig.samples, rig.decision
            assert samples.motor_position is not None
            on = [rig.arm.servo.energised(joint) for joint in range(7)]
            measured = (samples.current, samples.link_position, samples.motor_velocity)
            rows.append((on, np.array((*measured, samples.motor_position)), decision.velocity))

        rig.run(0.1, each)
        rig.request(Event.ENABLE)
        rig.run(0.6, each)
        rig.request(Event.START)
        rig.run(1.0, each)

    harness = Harness(Subject(robot=robot, settings=read_simulation(robot).settings))
    before, moved = np.zeros(7), 0.0
    was_on = [False] * 7
    for on, expected, velocity in rows:
        harness.period(np.zeros((10, 7)))
        np.testing.assert_array_equal(harness.sample(), expected)
        if all(on):
            if not all(was_on):
                harness.energise()
            harness.follow(before)
        was_on, before = on, velocity
        moved = max(moved, float(np.abs(expected[2]).max()))
    assert all(was_on)
    assert moved > 0.1


def still(seconds: float, *pushes: Push) -> Scenario:
    home = np.array([0.3, 0.3, 0.0, -0.8, -1.2, 0.0, 0.0])
    zero = np.zeros(7)
    motion = Motion(home=home, amplitude=zero, omega=zero, phase=zero)
    return Scenario(seconds=seconds, motion=motion, pushes=pushes, settling_s=0.1)


def test_recording_in_pieces_is_the_recording_in_one(robot: Robot) -> None:
    subject = Subject(robot=robot, settings=SimulationSettings(seed=4), drift=0.1)
    torque = np.array([0.0, 1.0, 0, 0, 0, 0, 0])
    scenario = still(0.5, Push(75, 233, torque))
    whole, pieces = record(subject, scenario), list(recordings(subject, scenario, 0.2))
    assert [len(piece.time_s) for piece in pieces] == [20, 20, 10]
    for name in ("time_s", "samples", "phi", "gear_torque", "external"):
        together = np.concatenate([getattr(piece, name) for piece in pieces])
        np.testing.assert_array_equal(together, getattr(whole, name))
    assert np.flatnonzero(whole.external[:, 1]).tolist() == list(range(75, 75 + 233))
    assert np.abs(whole.samples[5, 1] - whole.samples[30, 1]).max() > 1e-4  # it gave way


def test_the_loop_on_the_link_follows_its_motion(robot: Robot) -> None:
    zero = np.zeros(7)
    home = np.array([0.3, 0.3, 0.0, -0.8, -1.2, 0.0, 0.0])
    motion = Motion(
        home=home, amplitude=np.full(7, 0.2), omega=np.full(7, 2.0), phase=zero, ramp_s=0.5
    )
    subject = Subject(robot=robot, settings=SimulationSettings(seed=4))
    q = record(subject, Scenario(seconds=2.0, motion=motion, settling_s=0.3)).samples[:, 1]
    # After the ramp, s runs a quarter of a second behind the time.
    wanted = np.array([motion.at(t - 0.25, 1.0)[0] for t in 0.01 * np.arange(1, 201)])
    assert np.abs(q - wanted)[100:].max() < 0.05  # most of it is the gap
    assert np.ptp(q, axis=0).min() > 0.2


def test_every_disturbance_of_the_arm_shows(robot: Robot) -> None:
    """Friction drift, displaced centres of mass and another seed each change the samples."""
    plain = Subject(robot=robot, settings=SimulationSettings(seed=4))
    scenario = still(0.1)
    samples = record(plain, scenario).samples
    np.testing.assert_array_equal(record(plain, scenario).samples, samples)
    for other in (
        replace(plain, drift=0.2),
        replace(plain, displacement_m=0.005),
        replace(plain, settings=SimulationSettings(seed=5)),
    ):
        assert np.any(record(other, scenario).samples != samples)


def test_truth_is_taken_where_the_estimate_belongs() -> None:
    """Three periods of ten milliseconds, in which the truth counts them."""
    milliseconds = np.arange(30.0)[:, np.newaxis]
    recording = Recording(
        time_s=np.array([0.01, 0.02, 0.03]),
        samples=np.zeros((3, 4, 1)),
        phi=milliseconds,
        gear_torque=milliseconds,
        external=milliseconds,
        half_gap=np.array([2.5]),
        breakaway=np.zeros(1),
    )
    assert recording.at(0.0, recording.phi)[:, 0].tolist() == [9, 19, 29]
    assert recording.at(0.005, recording.phi)[:, 0].tolist() == [4, 14, 24]
    assert recording.mean(0.0, recording.phi)[:, 0].tolist() == [4.5, 14.5, 24.5]
    assert recording.mean(0.005, recording.phi)[:, 0].tolist() == [2.0, 9.5, 19.5]
    assert np.flatnonzero(recording.apart[:, 0]).tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("t", "rate"),
    [
        (0.0, 0.0), (1.0, 0.5), (2.0, 1.0), (7.9, 1.0), (9.0, 0.5), (10.0, 0.0), (12.9, 0.0),
        (14, 0.5),
    ],
)  # fmt: skip
def test_motion_starts_and_stops_softly(t: float, rate: float) -> None:
    one = np.ones(1)
    motion = Motion(home=one, amplitude=one, omega=one, phase=one, go_s=10.0, rest_s=3.0)
    assert motion.rate(t) == pytest.approx(rate)
    assert replace(motion, go_s=np.inf).rate(100.0 + t) == 1.0
    q, velocity = motion.at(t, rate)
    ahead, _ = motion.at(t + 1e-6 * rate, rate)
    assert (ahead - q) / 1e-6 == pytest.approx(velocity, abs=1e-5)


def test_the_torque_at_which_joints_break_away_is_that_of_the_arm_that_is_there(
    robot: Robot,
) -> None:
    """Friction of gear and link, as far as it has drifted, and with its rise near rest."""
    exactly = Mismatch(**dict.fromkeys(Mismatch.__struct_fields__, 0.0))
    settings = SimulationSettings(seed=1, mismatch=exactly, friction="dahl", stribeck=1.3)
    still = Motion(home=np.zeros(7), amplitude=np.zeros(7), omega=np.ones(7), phase=np.zeros(7))
    subject = Subject(robot=robot, settings=settings, drift=0.2)
    found = record(subject, Scenario(seconds=0.1, motion=still)).breakaway
    friction = [joint.friction for joint in robot.configuration.joints]
    exact = 1.3 * np.array([f.motor_coulomb + f.link_coulomb for f in friction])
    off = found / exact - 1.0
    assert np.abs(off).max() <= 0.2 + 1e-9
    assert np.ptp(off) > 0.05
