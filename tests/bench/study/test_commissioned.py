"""Figures of a commissioned arm: what is observable by the truth, and errors over intervals."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.rigs import upright_arm
from bench.rigs.person import CommissionedArm, Written
from bench.study.commissioned import observable, stated
from daemon.config import identified as file
from daemon.config.load import load_robot
from daemon.config.schema import Friction
from programs.identify.merge import merged
from programs.simulate.simulated_robot import true_arm
from simulator.mismatch import true_parameters

DAY = "2026-11-23T00:00:00+00:00"


def upright(folder: Path, **about: Any) -> CommissionedArm:
    arm = CommissionedArm(folder, upright_arm.write(folder / "upright"), **about)
    description, simulation = true_arm(load_robot(arm.truth))
    arm.true = true_parameters(description, simulation.settings)
    return arm


def test_gravity_that_keeps_its_side_within_the_limits_hides_the_gap(tmp_path: Path) -> None:
    def shut(written: Written) -> None:
        for i in (1, 2):  # leans forward, and stays there
            written["joints"][i]["limits"] |= {"lower": 0.5, "upper": 0.9}

    assert observable(upright(tmp_path / "free")).all()
    assert observable(upright(tmp_path / "shut", change=shut)).tolist() == [
        True, False, False, True, True, True,
    ]  # fmt: skip


def test_errors_are_over_the_stated_intervals(tmp_path: Path) -> None:
    arm = upright(tmp_path)
    true = arm.true
    assert true is not None
    alpha = file.GapEntry(
        date=DAY, log="0", half_gap=float(true.half_gap[1]) + 0.0003, confidence=0.0002
    )
    whole = float(true.coulomb[1] + true.coulomb[7])
    rubs = Friction(
        motor_coulomb=0.9 * whole, motor_viscous=0.1, link_coulomb=0.2 * whole, link_viscous=0.0
    )
    friction = file.FrictionEntry(
        date=DAY, log="0", friction=rubs, errors={"K_theta_s": 0.05 * whole, "B": 0.01}, r2=0.99,
        condition=3.0, gap_spring=file.GapSpring(stiffness=0.0, damping=0.0), rotor_inertia=None,
    )  # fmt: skip
    for step, entry in (("gap", alpha), ("friction", friction)):
        found = merged(load_robot(arm.folder), step, {"shoulder": entry}, {"shoulder": 1})  # type: ignore[arg-type]
        file.write_identified(arm.folder / "identified.yaml", found)
    of = stated(arm)
    assert of["alpha"].error[1] == pytest.approx(1.5, rel=0.01)
    assert of["K_theta_s"].error[1] == pytest.approx(0.1 / (1.96 * 0.05), rel=0.01)
    assert of["K_theta_s"].wide[1] == pytest.approx(100.0 * 3.92 * 0.05 / 1.1, rel=0.01)
    for one in (of["K_theta_v"], of["B"]):  # without an interval, and not trusted
        assert np.isnan(one.error).all()
    assert np.isfinite(of["alpha"].error).sum() == 1
