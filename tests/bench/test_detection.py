"""From the population to the figures of the detection bench."""

import math

import numpy as np
import pytest

from bench import population
from bench.detection import targets
from bench.detection_score import score
from bench.lockstep import ROMEO
from bench.monte_carlo import Job, Result, run
from bench.population import STEP_MS
from daemon.config.load import load_robot
from daemon.config.schema import Configuration


@pytest.fixture(scope="module")
def configuration() -> Configuration:
    return load_robot(ROMEO).configuration


@pytest.fixture(scope="module")
def moving() -> Result:
    return run(Job(ROMEO, "moving", "smooth", 21, 6.0, "measured"))


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
    drawn = population.steps(configuration, 3, list(range(0, 500_000, 1000)), usual)
    assert drawn == population.steps(configuration, 3, list(range(0, 500_000, 1000)), usual)
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


def test_steps_in_motion_are_felt_when_they_act(moving: Result) -> None:
    backlash = moving.names.index("backlash")
    assert len(moving.trials) == 2
    for trial in moving.trials:
        assert 0.0 < trial.delay_s[0] <= 0.010
        assert len(trial.delay_s) == trial.residuals.shape[1] == STEP_MS // 10
        # The residual comes to rest at the torque, give or take what the model does not know.
        shown = trial.residuals[backlash, -10:].mean() - trial.before[backlash]
        assert shown == pytest.approx(trial.size, rel=0.2)


def test_scores_and_targets_of_few_runs(configuration: Configuration, moving: Result) -> None:
    free = run(Job(ROMEO, "free", "smooth", 21, 3.0, "measured"))
    by_name = {name: score([free, moving], name, configuration) for name in free.names}
    best, classical = by_name["backlash"], by_name["classical"]
    assert best.alarms == 0
    assert classical.alarms_per_hour == pytest.approx(1200 * classical.alarms)
    assert sum(best.rms_nm) < 0.5 * sum(classical.rms_nm)
    assert best.tried_rest == 0
    assert math.isnan(best.smallest_rest_nm[0])
    found = {target.name: target for target in targets({"smooth": by_name}, configuration)}
    assert found["false alarms, backlash, smooth"].met
