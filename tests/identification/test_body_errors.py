"""Friction by a URDF whose bodies are off: intervals hold the truth, and stay narrow of others."""

from dataclasses import replace

import numpy as np
import pytest

from bench.rigs.foreign_logs import stranger
from daemon.assembly import build_transmission
from daemon.config.load import load_robot
from daemon.config.vectors import row
from identification.friction import identify_friction
from programs.recordings.raster import on_raster


@pytest.mark.parametrize(("right", "widest"), [(False, 0.8), (True, 0.12)])
def test_friction_beside_bodies_that_are_off(tmp_path, right: bool, widest: float) -> None:
    """Masses by a fifth, centres by 20 mm across gravity: viscous friction was good and off by 1.5
    intervals, in which gravity's share alone stood for the URDF."""
    of = stranger(1010, 30.0, tmp_path / "truth", by_urdf=right)
    robot = load_robot(tmp_path / "truth")
    c, log = robot.configuration, on_raster(of.log, of.log.stretches(1.0), 0.02)
    known = replace(build_transmission(c), half_gap=of.truth.half_gap,
                    torque_constant=of.truth.torque_constant)  # fmt: skip
    most = row(c, lambda j: j.wiring.max_current_A)
    fits, _ = identify_friction(log, robot.model, known, c.estimator, most)
    true = of.truth.viscous.reshape(2, -1).sum(axis=0)
    good = [i for i, fit in enumerate(fits) if fit.verdict == "good"]
    assert {0, 1, 3} <= {*good}
    half = np.array([fit.half_interval("K_theta_v") for fit in fits])
    off = np.array([fit.values["K_theta_v"] for fit in fits]) - true
    assert (np.abs(off) < half)[good].all()
    assert (half < widest * true)[good].all()
