"""Plant against itself in arrays; plant, servo and sensors compiled against plain."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from common.compiled import uncompiled
from simulator.description import ArmDescription, EncoderError, SimulationSettings
from simulator.gear_settings import GearSettings
from simulator.mismatch import true_parameters
from simulator.plant import Plant
from simulator.sensors import Sensors
from simulator.servo import Servo
from simulator.servo_periods import ServoPeriods
from tests.plain import built, plain
from tests.simulator import in_arrays

N, PER_PERIOD = 7, 4


def settings(friction: str, **changes: Any) -> SimulationSettings:
    return SimulationSettings(friction=friction, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("stribeck", [1.0, 1.3])
@pytest.mark.parametrize("friction", ["smooth", "dahl"])
def test_the_plant_is_that_in_arrays(romeo: ArmDescription, friction: str, stribeck: float) -> None:
    """To rounding; what that becomes where a border is struck a little sooner stays below 1e-9."""
    s = settings(friction, stribeck=stribeck)
    p = true_parameters(romeo, s)
    plant, other = Plant(p, s.step_s, s.law), in_arrays.Plant(p, s)
    plant.brake(3, closed=True)
    other.closed[3] = True
    plant.scale_friction(np.linspace(0.5, 1.5, N))
    other.scale = np.tile(np.linspace(0.5, 1.5, N), 2)
    rng = np.random.default_rng(2)
    struck = np.zeros(N)
    for _ in range(60):
        plant.motor_torque[:] = other.motor = 1.5 * rng.normal(size=N)
        plant.external_torque[:] = other.external = 0.5 * rng.normal(size=N)
        plant.advance(10)
        for _ in range(10):
            other.step()
        struck += plant.gear_torque != 0.0
        for name, found in (
            ("q", plant.q), ("phi", plant.phi), ("q_dot", plant.q_dot), ("theta", plant.theta_dot),
            ("gear", plant.gear_torque), ("friction", plant.friction_torque),
        ):  # fmt: skip
            values = {"theta": other.theta_dot, "gear": -other.gear}
            expected = values.get(name, getattr(other, name, None))
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9, err_msg=name)
    assert (struck > 0).all()
    assert np.abs(plant.q_dot).max() > 1.0


@pytest.mark.parametrize("friction", ["smooth", "dahl"])
def test_compiled_and_plain_are_the_same_to_the_last_bit(
    romeo: ArmDescription, friction: str
) -> None:
    if uncompiled():
        pytest.skip("the modules are not compiled here")
    s = settings(friction, link_latency_ms=1.5, stribeck=1.2)
    errors = tuple(EncoderError(encoder=of, amplitude=0.003) for of in ("link", "motor"))
    joints = tuple(replace(joint, encoder_errors=errors) for joint in romeo.joints)
    romeo = replace(romeo, joints=joints)
    p = true_parameters(romeo, s)
    worn = GearSettings(
        load_driving=0.2, load_driven=0.1, friction_ripple=20, cogging=5, rest_rise=1.5,
        rest_s=0.5, gap_ripple=30,
    )  # fmt: skip
    ends = []
    for modules in (built("simulator"), plain("simulator")):
        masses = modules["two_masses"].TwoMasses(
            modules["links"].Links(p.model), p, s.step_s, s.law,
            modules["gears"].Gears(worn, np.full(N, 100.0), np.ones(N), s.step_s, 4),
        )  # fmt: skip
        servo = modules["servo"].Servo(romeo, p.usual_link)
        sensors = modules["sensors"].Sensors(romeo, s, p.initial_position)
        laws = modules["motor_laws"].MotorLaws(servo)
        periods = modules["servo_periods"].ServoPeriods(
            servo, sensors, masses, p.torque_constant, laws
        )
        for joint in range(N):
            servo.energise(joint, 0.0)
            servo.follow(joint, 0.5, 0.05)
        servo.slew(1, 0.2, 3.0, 4.0)
        servo.tune(1, 2.0, 30.0)
        servo.release(2)
        laws.scale(2, 0.4, 1.0)
        laws.set_impedance(2, 0.3, 0.1, 20.0, 1.0, 0.5)
        laws.head(3, 0.2, 4.0, 0.6)
        laws.measure(4, 0.2)
        counts = []
        for _ in range(30):
            periods.run(5, PER_PERIOD, None)
            q, phi = np.asarray(masses.q), np.asarray(masses.phi)
            r = sensors.read(q, q - phi, laws.seen(np.asarray(masses.theta_dot)))
            counts.append((r.link_position, r.motor_position, r.motor_velocity, r.current))
        public = ("phi", "q", "q_dot", "theta_dot", "motor", "gear", "stop", "friction")
        state = [np.asarray(getattr(masses, name)).tobytes() for name in (*public, "deflection")]
        ends.append((counts, state, servo.current.tobytes(), servo.reference.tobytes()))
        assert np.abs(q - p.initial_position).max() > 0.02
    assert ends[0] == ends[1]


def test_periods_are_what_its_parts_do_one_after_the_other(romeo: ArmDescription) -> None:
    s = settings("smooth")
    p = true_parameters(romeo, s)
    states = []
    for at_once in (True, False):
        plant = Plant(p, s.step_s)
        servo, sensors = Servo(romeo, p.usual_link), Sensors(romeo, s, plant.q)
        for joint in range(N):
            servo.energise(joint, 0.0)
            servo.follow(joint, 0.3, 0.01)

        def touch(q: np.ndarray, q_dot: np.ndarray, out: np.ndarray) -> None:
            out[:] = 0.5 - 20.0 * q - q_dot

        if at_once:
            periods = ServoPeriods(servo, sensors, plant.masses, p.torque_constant)
            periods.run(20, PER_PERIOD, plant.touched_by(touch))
        else:
            for _ in range(20):
                servo.update(plant.theta_dot)
                np.multiply(p.torque_constant, servo.current, out=plant.motor_torque)
                sensors.update(plant.q, servo.current)
                for _ in range(PER_PERIOD):
                    touch(plant.q, plant.q_dot, plant.external_torque)
                    plant.advance(1)
        state = np.concatenate((plant.q, plant.phi, plant.theta_dot, servo.current))
        states.append(state.tobytes())
        assert np.abs(plant.external_torque).max() > 0.1
    assert states[0] == states[1]
