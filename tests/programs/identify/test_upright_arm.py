"""Upright arm: it swings at the default gain where its gaps are wide, not at the one advised."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import Rig, lockstep_rig
from common.arrays import Vector
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration
from daemon.config.vectors import row
from estimator.model import Model
from identification.limit_cycle import ENDING_SHARE, limit_cycles
from programs.identify.limit_cycle_watch import LimitCycleWatch
from programs.identify.measured import Measured, from_states
from programs.identify.steps.friction import friction_outcome
from programs.simulate.simulated_robot import true_arm
from simulator.mismatch import load_model, true_parameters
from tests.programs.identify import upright_arm

GAIN = 8.0


def held(folder: Path, gain: float) -> tuple[Measured, list[str]]:
    """Log of an arm that holds upright, after it was nudged; what was said meanwhile."""

    def with_gain(c: Configuration) -> Configuration:
        return msgspec.structs.replace(
            c, control=msgspec.structs.replace(c.control, position_gain=gain)
        )

    with lockstep_rig(
        folder, configure=with_gain, described=lambda robot, _: true_arm(robot)[0]
    ) as rig:
        rig.enable()
        nudge(rig)
        states = rig.states(11.0)
        names = rig.robot.configuration.joint_names
        watch = LimitCycleWatch(names, gain, half_gaps(rig.robot))
        said = [text for state in states if (text := watch.add(state))]
        return from_states(states, names), said


def half_gaps(robot: Robot) -> Vector:
    return row(robot.configuration, lambda joint: joint.half_gap)


def nudge(rig: Rig) -> None:
    for _ in range(30):
        rig.arm.plant.q_dot[:] += 0.03
        rig.step()


def test_upright_with_wide_gaps_it_swings_until_the_gain_is_what_was_reported(
    tmp_path: Path,
) -> None:
    folder = upright_arm.write(tmp_path / "arm", gaps=3.0, start={})
    swinging, said = held(folder, GAIN)
    gaps = half_gaps(load_robot(folder))
    cycles = limit_cycles(swinging.log, swinging.reference, gaps)
    assert {one.joint for one in cycles} == {"shoulder", "elbow", "wrist_pitch"}
    assert all(one.frequency_Hz == pytest.approx(2.1, abs=0.15) for one in cycles)
    (reported,) = said
    assert "swing by themselves at 2.1 Hz" in reported
    assert "control.position_gain to 2 (it was 8)" in reported
    quiet, said = held(folder, ENDING_SHARE * GAIN)
    assert limit_cycles(quiet.log, quiet.reference, gaps) == []
    assert said == []
    # Friction of a swinging joint fits well, and is wrong.
    outcome = friction_outcome(load_robot(folder), swinging, "2026-11-23", shortest_s=5.0)
    shoulder = next(line for line in outcome.lines if line.joint == "shoulder")
    assert (shoulder.verdict, shoulder.good) == ("swings by itself", False)
    assert "control.position_gain to 2" in shoulder.reason
    assert "shoulder" not in outcome.entries


def test_it_is_the_arm_of_its_description(tmp_path: Path) -> None:
    folder = upright_arm.write(tmp_path / "arm")
    robot = load_robot(folder)
    model = Model(robot.urdf, robot.configuration.joint_names)
    poses = np.random.default_rng(1).uniform(model.lower, model.upper, (500, 6))
    shoulder = max(abs(model.gravity(q)[1]) for q in poses)
    assert shoulder == pytest.approx(13.0, abs=0.5)
    description, simulation = true_arm(robot)
    true = true_parameters(description, simulation.settings)
    assert (true.stiffness[:3] == upright_arm.STIFFNESS).all()
    masses = [body.mass for body in true.model.inertias][1:]
    nominal = [body.mass for body in load_model(description).inertias][1:]
    off = np.abs(np.array(masses) / np.array(nominal) - 1.0)
    assert off == pytest.approx(np.full(6, 0.1))
