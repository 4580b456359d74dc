"""The plant against physics: conservation, one-sided contact, friction, end stops."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from simulator.description import ArmDescription, SimulationSettings
from simulator.friction_law import FrictionLaw
from simulator.mismatch import PlantParameters, true_parameters
from simulator.plant import Plant

STEP = 0.00025
Pendulum = Callable[..., PlantParameters]


def still(parameters: PlantParameters) -> PlantParameters:
    zero = np.zeros_like(parameters.coulomb)
    return replace(parameters, coulomb=zero, viscous=zero, damping=zero[: len(zero) // 2])


def test_energy_is_conserved_without_friction_and_damping(pendulum: Pendulum) -> None:
    plant = Plant(pendulum(), STEP)
    plant.place(np.array([1.0]))
    start = plant.energy()
    swings = 0
    for _ in range(200):
        plant.advance(100)
        swings += bool(plant.in_gap[0])
        assert plant.energy() == pytest.approx(start, abs=0.01)
    assert 0 < swings < 200  # it did bounce through the gap


def test_whole_arm_conserves_energy(romeo: ArmDescription) -> None:
    plant = Plant(still(true_parameters(romeo, SimulationSettings())), STEP)
    start = plant.energy()
    moved = 0.0
    for _ in range(20):
        plant.advance(40)
        moved = max(moved, float(np.abs(plant.q_dot).max()))
        assert plant.energy() == pytest.approx(start, abs=0.01)
    assert moved > 1.0


def test_momentum_of_link_and_rotor_is_conserved(pendulum: Pendulum) -> None:
    """Whatever happens inside the gear is internal: no gravity, no friction, B w + I w' stays."""
    parameters = pendulum(damping=np.array([2.0]))
    parameters.model.gravity = pin.Motion.Zero()
    plant = Plant(parameters, STEP)
    plant.theta_dot[0] = 1.0
    knocks = 0
    for _ in range(400):
        plant.advance(10)
        knocks += bool(abs(plant.gear_torque[0]) > 0.0)
        momentum = 0.05 * plant.theta_dot[0] + 0.021 * plant.q_dot[0]
        assert momentum == pytest.approx(0.05, abs=1e-9)
    assert knocks
    together = 0.05 / 0.071
    assert plant.q_dot[0] == pytest.approx(together, abs=0.1)


@pytest.mark.parametrize("half_gap", [0.0, 0.02])
def test_gear_pushes_and_never_pulls(pendulum: Pendulum, half_gap: float) -> None:
    """With much damping a departing contact would pull if it were not cut off."""
    parameters = pendulum(half_gap=np.array([half_gap]), damping=np.array([15.0]))
    plant = Plant(parameters, STEP)
    plant.place(np.array([0.5]))
    rng = np.random.default_rng(3)
    seen = set()
    for _ in range(3000):
        plant.motor_torque[0] = rng.normal(0.0, 3.0)
        before = float(plant.phi[0])
        plant.advance(1)
        torque = plant.gear_torque[0]
        if abs(before) <= half_gap:
            assert torque == 0.0
        else:
            assert torque * np.sign(before) <= 0.0
        seen.add((before > half_gap) - (before < -half_gap))
    assert seen >= {-1, 1}


@pytest.mark.parametrize("friction", ["smooth", "dahl"])
def test_friction_opposes_sliding_and_dissipates(pendulum: Pendulum, friction: str) -> None:
    parameters = pendulum(coulomb=np.array([0.02, 0.1]), viscous=np.array([0.01, 0.05]))
    plant = Plant(parameters, STEP, FrictionLaw(friction))  # type: ignore[arg-type]
    plant.place(np.array([1.0]))
    start = plant.energy()
    for _ in range(4000):
        before = np.concatenate((plant.q_dot, plant.theta_dot))
        plant.advance(1)
        fast = np.abs(before) > 0.2
        if friction == "smooth":
            assert (plant.friction_torque * before >= 0.0).all()
            assert (np.abs(plant.friction_torque) >= 0.99 * parameters.coulomb)[fast].all()
        limit = parameters.coulomb + parameters.viscous * np.abs(before)
        assert (np.abs(plant.friction_torque) <= limit + 1e-12).all()
    assert plant.energy() < start - 0.3


def test_viscous_friction_alone_slows_down_exponentially(pendulum: Pendulum) -> None:
    parameters = pendulum(viscous=np.array([0.0, 0.1]))
    plant = Plant(parameters, STEP)
    plant.weigh(np.zeros(3))
    plant.theta_dot[0] = 0.05  # crosses less than half the gap in this time
    plant.advance(1000)
    assert plant.theta_dot[0] == pytest.approx(0.05 * np.exp(-0.1 / 0.05 * 0.25), rel=2e-3)


@pytest.mark.parametrize(("torque", "slides"), [(0.8, False), (1.2, True), (-0.8, False)])
def test_stiction_holds_below_and_breaks_away_above(
    pendulum: Pendulum, torque: float, slides: bool
) -> None:
    parameters = pendulum(coulomb=np.array([0.0, 1.0]), half_gap=np.array([0.5]))
    plant = Plant(parameters, STEP, FrictionLaw("dahl", presliding=0.001))
    for share in np.linspace(0.0, 1.0, 100):  # a sudden load would overshoot
        plant.motor_torque[0] = share * torque
        plant.advance(20)
    plant.advance(1000)
    if slides:
        assert plant.theta[0] > 0.1
        assert plant.theta_dot[0] > 0.5
    else:
        # Along d theta = dz / (1 - |z| / z_max).
        where = float(plant.theta[0])
        assert where == pytest.approx(-0.001 * np.log(0.2) * np.sign(torque), rel=0.05)
        plant.advance(4000)
        assert plant.theta[0] == pytest.approx(where, abs=1e-6)  # no creep


def test_smooth_friction_creeps_where_stiction_holds(pendulum: Pendulum) -> None:
    parameters = pendulum(coulomb=np.array([0.0, 1.0]), half_gap=np.array([0.5]))
    plant = Plant(parameters, STEP, FrictionLaw("smooth", width=0.02))
    plant.motor_torque[0] = 0.8
    plant.advance(8000)
    assert plant.theta_dot[0] == pytest.approx(0.02 * np.arctanh(0.8), rel=1e-3)


def test_end_stop_holds_the_link(pendulum: Pendulum) -> None:
    parameters = pendulum(
        upper=np.array([0.3]), damping=np.array([3.0]), viscous=np.array([0.1, 0.1])
    )
    plant = Plant(parameters, STEP)
    plant.external_torque[0] = 5.0
    plant.advance(8000)
    gravity = 0.5 * 9.81 * 0.2 * np.sin(plant.q[0])
    assert plant.q[0] == pytest.approx(0.3 + (5.0 - gravity) / 1000.0, abs=2e-4)
    assert abs(plant.q_dot[0]) < 1e-3


def test_torque_goes_through_the_gear_to_the_link(pendulum: Pendulum) -> None:
    """At rest against gravity the gear carries the load, phi beyond alpha on the loaded side."""
    parameters = pendulum(damping=np.array([3.0]), viscous=np.array([0.1, 0.1]))
    plant = Plant(parameters, STEP)
    plant.motor_torque[0] = 0.4
    plant.advance(40000)
    assert plant.gear_torque[0] == pytest.approx(0.4, abs=1e-4)
    assert plant.phi[0] == pytest.approx(-0.02 - 0.4 / 1000.0, abs=1e-5)
    assert np.sin(plant.q[0]) == pytest.approx(0.4 / (0.5 * 9.81 * 0.2), abs=1e-3)


def test_brake_holds_the_motor(pendulum: Pendulum) -> None:
    plant = Plant(pendulum(), STEP)
    plant.motor_torque[0] = 2.0
    plant.theta_dot[0] = 0.5
    plant.brake(0, closed=True)
    plant.advance(2000)
    assert plant.theta[0] == pytest.approx(0.0, abs=1e-12)
    plant.brake(0, closed=False)
    plant.advance(400)
    assert plant.theta_dot[0] > 1.0


@pytest.mark.parametrize("friction", ["smooth", "dahl"])
def test_limp_arm_comes_to_rest_at_all_poses(romeo: ArmDescription, friction: str) -> None:
    """The explicit step carries contact, stops and friction even where links are lightest."""
    parameters = true_parameters(romeo, SimulationSettings())
    rng = np.random.default_rng(5)
    for _ in range(2):
        plant = Plant(parameters, STEP, FrictionLaw(friction))  # type: ignore[arg-type]
        plant.place(rng.uniform(parameters.lower, parameters.upper))
        plant.advance(6000)
        assert np.abs(plant.q_dot).max() < 1.0
        assert (plant.q > parameters.lower - 0.05).all()
        assert (plant.q < parameters.upper + 0.05).all()


def test_a_press_works_as_much_as_the_joints_do(romeo: ArmDescription) -> None:
    plant = Plant(true_parameters(romeo, SimulationSettings()), STEP)
    q, force, small = np.linspace(-0.6, 0.5, 7), np.array([3.0, -8.0, 5.0]), 1e-6
    model = plant.parameters.model.copy()
    data = model.createData()

    def tool(turned: int, by: float) -> np.ndarray:
        pin.forwardKinematics(model, data, q + by * np.eye(7)[turned])
        at: np.ndarray = data.oMi[7].act(plant.held_at)
        return at

    pin.framesForwardKinematics(model, data, q)
    hand = data.oMf[model.getFrameId("l_wrist")].rotation @ force
    expected = [hand @ (tool(i, small) - tool(i, -small)) / (2.0 * small) for i in range(7)]
    np.testing.assert_allclose(plant.pressed(q, force), expected, atol=1e-6)


def test_a_carried_load_has_its_weight_and_can_be_removed(romeo: ArmDescription) -> None:
    plant = Plant(still(true_parameters(romeo, SimulationSettings())), STEP)
    place, q = np.array([0.08, 0.01, -0.02]), np.full(7, 0.2)

    def acceleration() -> np.ndarray:
        out = np.zeros(7)
        plant.masses.links.accelerate(q, np.zeros(7), np.zeros(7), out)
        return out

    before = acceleration()
    for mass in (0.9, 0.4):  # in place of the first
        plant.carry(mass, place)
    loaded = plant.parameters.model
    nominal = Plant(true_parameters(romeo, SimulationSettings()), STEP)
    expected = nominal.parameters.model.copy()
    expected.inertias[7] += pin.Inertia(0.4, place, np.zeros((3, 3)))
    zero = np.zeros(7)
    theirs = pin.aba(expected, expected.createData(), q, zero, zero)
    np.testing.assert_allclose(acceleration(), theirs, rtol=1e-9, atol=1e-9)
    assert loaded.inertias[7].mass == pytest.approx(expected.inertias[7].mass)
    assert np.abs(acceleration() - before).max() > 0.1
    plant.carry(0.0, place)
    np.testing.assert_array_equal(acceleration(), before)
