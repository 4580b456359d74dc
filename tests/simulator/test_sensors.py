"""Counts, noise, delay and filters of what the drives report."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from simulator.description import ArmDescription, EncoderError, SimulationSettings
from simulator.profile import PROFILE, TURN
from simulator.sensors import Sensors

N = 7
ZERO = np.zeros(N)
QUIET: dict[str, Any] = {"velocity_noise": 0.0, "current_noise_permille": 0.0}


def sensors(romeo: ArmDescription, **settings: Any) -> Sensors:
    return Sensors(romeo, SimulationSettings(**{**QUIET, **settings}), ZERO)


def test_counts_of_the_profile(romeo: ArmDescription) -> None:
    one = np.full(N, 1.0)
    readings = sensors(romeo).read(one, one, one)
    gears = np.array([joint.gear for joint in romeo.joints])
    assert readings.link_position == [round(131072 / (2 * np.pi))] * N
    assert readings.motor_position == np.rint(gears * 4096 / (2 * np.pi)).tolist()
    assert readings.motor_velocity == np.rint(gears * 600 / (2 * np.pi)).tolist()


def test_an_encoder_reads_wrong_again_with_every_turn(romeo: ArmDescription) -> None:
    errors = (
        EncoderError(encoder="link", order=1, amplitude=0.0005, phase=0.3),
        EncoderError(encoder="link", order=2, amplitude=0.0003),
        EncoderError(encoder="motor", order=3, amplitude=0.002, phase=-1.0),
    )
    off = 2
    joints = list(romeo.joints)
    joints[off] = replace(joints[off], encoder_errors=errors)
    wrong = sensors(replace(romeo, joints=tuple(joints)))
    right, gear = sensors(romeo), romeo.joints[off].gear
    for angle in np.linspace(-2.0, 2.0, 41):
        at = np.full(N, angle)
        found, meant = wrong.read(at, at, ZERO), right.read(at, at, ZERO)
        link, motor = (
            np.subtract(getattr(found, name), getattr(meant, name)) * TURN / counts
            for name, counts in (("link_position", 131072), ("motor_position", 4096 * gear))
        )
        expected = 0.0005 * np.sin(angle + 0.3) + 0.0003 * np.sin(2.0 * angle)
        assert link[off] == pytest.approx(expected, abs=5e-5)
        assert motor[off] == pytest.approx(0.002 * np.sin(3.0 * gear * angle - 1.0), abs=2e-5)
        assert not np.delete(link, off).any()
        assert not np.delete(motor, off).any()
        assert found.motor_velocity == meant.motor_velocity


@pytest.mark.parametrize("latency", [0.0, 5.0])
def test_a_drive_without_a_link_encoder_reads_the_motor(
    romeo: ArmDescription, latency: float
) -> None:
    makes = [replace(PROFILE, link_at_motor=i == 2) for i in range(N)]
    settings = SimulationSettings(**QUIET, link_latency_ms=latency)
    one = Sensors(romeo, settings, ZERO, makes)
    for _ in range(10):
        one.update(np.full(N, 1.0), ZERO)
    link = np.array(one.read(np.full(N, 1.0), np.full(N, 0.5), ZERO).link_position)
    assert link[2] == round(0.5 * 131072 / TURN)
    assert set(np.delete(link, 2)) == {round(131072 / TURN)}


def test_current_is_low_passed_by_3_ms(romeo: ArmDescription) -> None:
    sensor = sensors(romeo)
    rated = np.array([joint.rated_current_A for joint in romeo.joints])
    for _ in range(3):
        sensor.update(ZERO, rated)
    assert sensor.read(ZERO, ZERO, ZERO).current == [round(1000 * (1 - np.exp(-1.0)))] * N
    sharp = sensors(romeo, current_filter_ms=0.0)
    sharp.update(ZERO, rated)
    assert sharp.read(ZERO, ZERO, ZERO).current == [1000] * N


@pytest.mark.parametrize("latency", [0.0, 0.5, 1.0, 2.5, 10.0])
def test_link_encoder_is_late(romeo: ArmDescription, latency: float) -> None:
    sensor = sensors(romeo, link_latency_ms=latency)
    for k in range(1, 31):
        sensor.update(np.full(N, 0.01 * k), ZERO)
    counts = sensor.read(np.full(N, 0.30), ZERO, ZERO).link_position[0]
    assert counts * 2 * np.pi / 131072 == pytest.approx(0.01 * (30 - latency), abs=3e-5)


def test_velocity_may_be_wrong_by_scale_and_bias(romeo: ArmDescription) -> None:
    sensor = sensors(romeo, velocity_scale_error=0.01, velocity_bias=0.005)
    counts = np.array(sensor.read(ZERO, ZERO, np.full(N, 0.5)).motor_velocity)
    gears = np.array([joint.gear for joint in romeo.joints])
    unit = 0.1 * 2 * np.pi / 60 / gears
    assert counts * unit == pytest.approx(np.full(N, 0.51), abs=1e-4)


def test_noise_is_seeded_and_as_strong_as_said(romeo: ArmDescription) -> None:
    def draw(seed: int) -> list[list[int]]:
        sensor = sensors(romeo, seed=seed, velocity_noise=0.01, current_noise_permille=5.0)
        readings = [sensor.read(ZERO, ZERO, ZERO) for _ in range(400)]
        return [r.motor_velocity + r.current for r in readings]

    rows = np.array(draw(1))
    assert draw(1) == rows.tolist()
    assert draw(2) != rows.tolist()
    unit = 0.1 * 2 * np.pi / 60 / 150
    assert np.std(rows[:, 0]) * unit == pytest.approx(0.01, rel=0.15)
    assert np.std(rows[:, N:]) == pytest.approx(5.0, rel=0.1)
