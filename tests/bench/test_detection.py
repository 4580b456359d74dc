"""Detection bench, from the population to its figures."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bench.detection import alarmed, targets, worth
from bench.rigs.arm_without_bus import Harness
from bench.rigs.lockstep import ROMEO
from bench.study import population, world
from bench.study.detection_score import score
from bench.study.monte_carlo import Job, Result, run
from bench.study.population import STEP_MS
from daemon.config.load import load_robot
from daemon.config.schema import Configuration
from simulator.description import Mismatch, SimulationSettings


@pytest.fixture(scope="module")
def configuration() -> Configuration:
    return load_robot(ROMEO).configuration


@pytest.fixture(scope="module")
def moving() -> Result:
    return run(Job(ROMEO, "moving", "smooth", 21, 6.0, "measured", worked_s=30.0))


@pytest.fixture(scope="module")
def free() -> Result:
    return run(Job(ROMEO, "free", "smooth", 21, 3.0, "measured", worked_s=30.0))


def test_every_motion_stays_inside_limits_and_velocities(configuration: Configuration) -> None:
    joints = configuration.joints
    for seed in range(50):
        m = population.motion(configuration, seed)
        for i, joint in enumerate(joints):
            assert joint.limits.lower < m.home[i] - m.amplitude[i]
            assert m.home[i] + m.amplitude[i] < joint.limits.upper
            assert m.amplitude[i] * m.omega[i] < 0.7 * joint.limits.velocity


def test_steps_of_all_sizes_reach_all_joints(configuration: Configuration) -> None:
    usual = np.arange(1.0, 8.0)
    smallest, _, largest = population.sizes(configuration)
    drawn, again = (
        population.steps(configuration, 3, list(range(0, 500_000, 1000)), usual) for _ in "ab"
    )
    assert drawn == again
    for i in range(7):
        mine = [abs(step.torque) for step in drawn if step.joint == i]
        assert 15 <= mine.count(usual[i]) <= 40
        others = [size for size in mine if size != usual[i]]
        assert smallest[i] <= min(others) < 2.0 * smallest[i]
        assert 0.8 * largest[i] < max(others) <= largest[i]
        assert {np.sign(step.torque) for step in drawn if step.joint == i} == {-1.0, 1.0}


@pytest.mark.parametrize("seed", [0, 1])
def test_steps_do_not_overlap_and_rests_hold_theirs(seed: int) -> None:
    for onsets in (population.onsets_in_motion(60.0, seed), population.onsets_at_rest(60.0, seed)):
        assert np.diff(onsets).min() > 2 * STEP_MS
        assert onsets[-1] + STEP_MS < 60_000
    cycle = population.GO_S + population.REST_S
    for onset in population.onsets_at_rest(60.0, seed):
        assert population.GO_S + 0.9 < 1e-3 * onset % cycle < cycle - 0.5


def test_steps_in_motion_show_in_the_residual_at_once(moving: Result) -> None:
    backlash = moving.names.index("backlash")
    assert len(moving.trials) == 2
    for trial in moving.trials:
        assert 0.0 < trial.delay_s[0] <= 0.010
        assert len(trial.delay_s) == trial.residuals.shape[1] == STEP_MS // 10
        # The residual comes to rest at the torque, give or take what the model does not know.
        shown = trial.residuals[backlash, -10:].mean() - trial.before[backlash]
        assert shown == pytest.approx(trial.size, rel=0.2)


def test_scores_and_targets_of_few_runs(
    configuration: Configuration, moving: Result, free: Result
) -> None:
    by_name = {name: score([free, moving], name, configuration) for name in free.names}
    best, classical = by_name["backlash"], by_name["classical"]
    assert best.alarms == 0
    assert classical.alarms_per_hour == pytest.approx(1200 * classical.alarms)
    assert sum(best.rms_nm) < 0.5 * sum(classical.rms_nm)
    assert best.tried_rest == 0
    assert math.isnan(best.smallest_rest_nm[0])
    found = {target.name: target for target in targets({"smooth": by_name}, configuration)}
    assert found["false alarms in 0.000833 h, backlash, smooth"].met
    noisy = replace(free, alarms=np.eye(*free.alarms.shape, dtype=np.int64))
    first = configuration.joints[0].name
    assert alarmed([free, moving], configuration.joint_names) == []
    assert alarmed([noisy, moving], configuration.joint_names) == [f"{first} of arm 21 (1)"]


def test_a_joint_without_a_result_meets_no_target(
    configuration: Configuration, moving: Result, free: Result
) -> None:
    best = replace(score([free, moving], "backlash", configuration), smallest_moving_nm=[0.1] * 7)
    classical = replace(best, smallest_moving_nm=[0.5, 0.6, 0.7, 0.1, 0.1, 0.1, 0.8])
    gaps = [0, 1, 2, 6]
    assert worth(best, classical, gaps) == pytest.approx(5.0)
    for unknown in gaps:
        smallest = [math.nan if i == unknown else 0.1 for i in range(7)]
        assert math.isnan(worth(replace(best, smallest_moving_nm=smallest), classical, gaps))
    found = targets({"smooth": {"backlash": best, "classical": classical}}, configuration)
    assert [t.met for t in found if t.name.startswith("smallest step")] == [False, False]


@pytest.mark.parametrize("seed", [1, 2])
def test_every_simulated_arm_has_the_stated_errors(seed: int) -> None:
    robot = load_robot(ROMEO)
    subject = world.subject(robot, "dahl", seed)
    right = Mismatch(**dict.fromkeys(Mismatch.__struct_fields__, 0.0))
    exact = replace(subject, settings=SimulationSettings(mismatch=right), displacement_m=0.0)
    arm, model = (Harness(each).parameters for each in (subject, exact))
    bodies, gaps = range(1, model.model.njoints), model.half_gap > 0.0
    off = {
        "mass": [arm.model.inertias[i].mass / model.model.inertias[i].mass - 1 for i in bodies],
        "torque_constant": arm.torque_constant / model.torque_constant - 1,
        "rotor_inertia": arm.rotor_inertia / model.rotor_inertia - 1,
        "coulomb": (arm.coulomb / model.coulomb - 1)[model.coulomb > 0.0],
        "half_gap": arm.half_gap[gaps] / model.half_gap[gaps] - 1,
        "center_of_mass": [
            np.linalg.norm(arm.model.inertias[i].lever - model.model.inertias[i].lever)
            for i in bodies
        ],
    }
    expected = {
        "mass": 0.05, "torque_constant": 0.03, "rotor_inertia": 0.1, "coulomb": 0.4,
        "half_gap": 0.1, "center_of_mass": 0.005,
    }  # fmt: skip
    for name, values in off.items():
        np.testing.assert_allclose(np.abs(values), expected[name], rtol=1e-6, err_msg=name)
    assert subject.settings.friction == "dahl"
    assert subject.drift == 0.2
    latencies = [world.subject(robot, "dahl", s).settings.link_latency_ms for s in range(99)]
    assert 0.0 < min(latencies) < 0.1
    assert 0.9 < max(latencies) < 1.0
