"""Steps of the plant: fine enough that friction does not turn a light rotor round by itself."""

import numpy as np
import pinocchio as pin
import pytest

from bench.rigs.lockstep import BEAM, OPENARM
from daemon.config.load import load_robot
from programs.simulate.simulated_robot import true_arm
from simulator.arm import SimulatedArm
from simulator.description import SimulationSettings
from simulator.mismatch import steady_steps
from simulator.plant import Plant


@pytest.mark.parametrize(("arm", "step_s"), [(OPENARM, 0.00025), (BEAM, 0.001 / 9)])
def test_a_limp_arm_comes_to_rest(arm, step_s: float) -> None:
    description, simulation = true_arm(load_robot(arm))
    simulated = SimulatedArm(description, simulation.settings, lambda message: None)
    assert simulated.settings.step_s == pytest.approx(step_s)
    simulated.advance(3.0)
    assert np.abs(simulated.plant.theta_dot).max() < 0.015


def test_a_light_link_does_not_chatter_on_its_friction(pendulum) -> None:
    """A wrist of 0.0003 kg m2 with 0.25 Nm: it crept twice too fast under 0.2 Nm."""
    light = np.array([3e-4])
    p = pendulum(coulomb=np.array([0.25, 0.0]), half_gap=np.ones(1), lightest_link=light)
    p.model.inertias[1] = pin.Inertia(1e-6, np.zeros(3), 3e-4 * np.eye(3))
    per_ms = steady_steps(SimulationSettings(), p)
    plant = Plant(p, 0.001 / per_ms)
    plant.brake(0, closed=True)
    plant.external_torque[:] = 0.2
    plant.advance(1000 * per_ms)
    assert plant.q[0] == pytest.approx(0.02 * np.arctanh(0.8), rel=0.02)
