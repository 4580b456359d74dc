"""Gears beyond the estimator's model, alone and in the plant."""

from collections.abc import Callable

import numpy as np
import pytest

from simulator.description import ArmDescription, SimulationSettings
from simulator.friction_law import FrictionLaw
from simulator.gear_settings import GearSettings
from simulator.gears import Gears
from simulator.mismatch import PlantParameters, true_gears, true_parameters
from simulator.plant import Plant

STEP = 0.00025
Pendulum = Callable[..., PlantParameters]


def gears(n: int = 1, ratio: float = 100.0, rated: float = 2.0, **settings: float) -> Gears:
    made = GearSettings(**settings)  # type: ignore[arg-type]
    return Gears(made, np.full(n, ratio), np.full(n, rated), STEP, seed=3)


def test_neutral_settings_are_the_gear_of_the_model() -> None:
    neutral = gears()
    assert not neutral.active
    neutral.update(0, 0.3, 0.3, 0.5)
    assert np.asarray(neutral.factor).tolist() == [[1.0], [1.0]]
    assert (neutral.coulomb(5.0, 0.5), neutral.cog(0, 0.3)) == (0.0, 0.0)
    assert neutral.half_gap(0, 0.02, 0.3) == 0.02


@pytest.mark.parametrize(
    ("gear_torque", "theta_dot", "share"),
    # The torque on the motor is against its velocity where it drives the link.
    [(-4.0, 0.5, 0.3), (4.0, -0.5, 0.3), (4.0, 0.5, 0.1), (-4.0, -0.5, 0.1), (4.0, 0.0, 0.2)],
)
def test_load_costs_another_share_driving_and_driven(
    gear_torque: float, theta_dot: float, share: float
) -> None:
    made = gears(load_driving=0.3, load_driven=0.1)
    assert made.coulomb(gear_torque, theta_dot) == pytest.approx(share * 4.0, rel=1e-6)


def test_friction_ripples_twice_a_turn_of_motor_and_joint() -> None:
    made = gears(friction_ripple=20.0, ratio=50.0)

    def factor(q: float, theta: float) -> list[float]:
        made.update(0, q, theta, 1.0)
        return [float(made.factor[side, 0]) for side in (0, 1)]

    turn = np.linspace(0.0, 2.0 * np.pi, 1000, endpoint=False)
    link = np.array([factor(q, 0.0)[0] for q in turn])
    motor = np.array([factor(0.0, angle / 50.0)[1] for angle in turn])
    for values in (link, motor):
        assert (values.min(), values.max()) == pytest.approx((0.8, 1.2), abs=1e-3)
        assert np.abs(np.fft.rfft(values))[1:].argmax() == 1
    assert factor(0.0, 0.3)[0] == factor(0.0, 0.7)[0]


def test_cogging_is_a_share_of_the_rated_torque_twelve_times_a_turn() -> None:
    made = gears(cogging=5.0, ratio=50.0, rated=3.0)
    turn = np.linspace(0.0, 2.0 * np.pi, 1200, endpoint=False)
    torque = np.array([made.cog(0, angle / 50.0) for angle in turn])
    assert np.abs(torque).max() == pytest.approx(0.15, rel=1e-3)
    assert np.abs(np.fft.rfft(torque)).argmax() == 12


def test_rest_raises_friction_and_motion_takes_that_away() -> None:
    made = gears(rest_rise=1.5, rest_s=60.0)
    for _ in range(int(60.0 / STEP)):
        made.update(0, 0.0, 0.0, 0.0)
    expected = 1.0 + 0.5 * (1.0 - np.exp(-1.0))
    assert [made.factor[side, 0] for side in (0, 1)] == pytest.approx([expected] * 2, rel=1e-3)
    for _ in range(int(60.0 / STEP)):
        made.update(0, 0.0, 0.0, 0.1)
    assert 1.0 < made.factor[1, 0] < 1.03


def test_the_gap_varies_once_a_turn_of_the_joint() -> None:
    made = gears(gap_ripple=30.0)
    turn = np.linspace(0.0, 2.0 * np.pi, 1000, endpoint=False)
    half_gap = np.array([made.half_gap(0, 0.02, q) for q in turn])
    assert (half_gap.min(), half_gap.max()) == pytest.approx((0.014, 0.026), rel=1e-3)
    assert np.abs(np.fft.rfft(half_gap))[1:].argmax() == 0


@pytest.mark.parametrize("way", [0.3, -0.3])
@pytest.mark.parametrize("friction", ["smooth", "dahl"])
def test_a_motor_pays_for_what_its_gear_transmits(
    pendulum: Pendulum, friction: str, way: float
) -> None:
    """Led slowly upwards against gravity, where it drives, and downwards, where it is driven."""
    made = gears(load_driving=0.25, load_driven=0.1)
    law = FrictionLaw(friction, presliding=0.001)  # type: ignore[arg-type]
    plant = Plant(pendulum(half_gap=np.zeros(1)), STEP, law, made)
    plant.place(np.array([0.8]))
    paid, transmitted = [], []
    for k in range(4000):
        held = float(plant.weight(plant.q)[0])
        plant.motor_torque[0] = held + 5.0 * (way - plant.theta_dot[0])
        plant.advance(1)
        if k > 2000:
            paid.append(plant.friction_torque[1])
            transmitted.append(abs(plant.gear_torque[0]))
    share = 0.25 if way * plant.weight(plant.q)[0] > 0.0 else 0.1
    assert np.mean(transmitted) > 0.4
    assert np.mean(paid) == pytest.approx(np.sign(way) * share * np.mean(transmitted), rel=0.02)


def test_gears_of_the_arm_count_in_the_plant_and_phases_come_from_the_seed(
    romeo: ArmDescription,
) -> None:
    ends = []
    for seed, ripple in ((1, 0.0), (1, 30.0), (1, 30.0), (2, 30.0)):
        s = SimulationSettings(seed=seed, gears=GearSettings(gap_ripple=ripple))
        p = true_parameters(romeo, SimulationSettings())
        plant = Plant(p, s.step_s, s.law, true_gears(romeo, s, p.torque_constant))
        plant.external_torque[:] = 0.3
        plant.advance(400)
        ends.append(plant.q.tobytes())
        half_gap = np.asarray(plant.masses.half_gap)
        assert (half_gap == p.half_gap).all() == (ripple == 0.0)
    assert ends[1] == ends[2]
    assert len(set(ends)) == 3
