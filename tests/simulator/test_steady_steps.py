"""Steps of the plant: fine enough that friction does not turn a light rotor round by itself."""

import numpy as np
import pytest

from bench.rigs.lockstep import BEAM, OPENARM
from daemon.config.load import load_robot
from programs.simulate.simulated_robot import true_arm
from simulator.arm import SimulatedArm


@pytest.mark.parametrize(("arm", "step_s"), [(OPENARM, 0.00025), (BEAM, 0.001 / 9)])
def test_a_limp_arm_comes_to_rest(arm, step_s: float) -> None:
    description, simulation = true_arm(load_robot(arm))
    simulated = SimulatedArm(description, simulation.settings, lambda message: None)
    assert simulated.settings.step_s == pytest.approx(step_s)
    simulated.advance(3.0)
    assert np.abs(simulated.plant.theta_dot).max() < 0.015
