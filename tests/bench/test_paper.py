"""One figure of the paper, from the bus to the PNG, on a short run."""

import io
import json

import numpy as np
import pytest

from bench.paper import figure_02
from bench.paper.experiments import Conditions, least_at_rest, pushes, single_joint
from bench.paper.figure import crossings, runs, save
from bench.rigs.lockstep import ROMEO
from daemon.config.load import load_robot


@pytest.fixture(scope="module")
def recording():
    """Out of the middle of the gap, and once through it."""
    return single_joint(Conditions(), 4.6)


def test_only_the_classical_residual_takes_a_crossing_for_a_contact(recording):
    table = figure_02.numbers(recording)
    assert table["crossings"] == 2
    threshold = 0.5
    assert table["while_crossing_nm"]["classical"] > 1.5 * threshold
    assert table["while_crossing_nm"]["backlash"] < threshold
    assert table["residuals"]["classical"]["false"] != [0]
    assert table["residuals"]["backlash"]["false"] == [0]
    assert table["residuals"]["backlash"]["detected"] == [0]
    json.dumps(table)


def test_crossings_are_where_the_plant_was_free(recording):
    phi = recording.true_q[:, 0] - recording.true_theta[:, 0]
    _, (begin, end) = crossings(recording, 0)
    at = np.searchsorted(recording.time_s, [begin, end])
    assert phi[at[0]] < -0.09
    assert phi[at[1]] > 0.09


def test_the_rival_sees_what_the_product_sees(recording):
    later = recording.time_s > 1.0
    error = recording.residuals["kalman"] - recording.residuals["classical+friction+rotor"]
    assert np.sqrt(np.mean(np.square(error[later]))) < 0.03


def test_the_picture_is_small_and_complete(recording):
    figure = figure_02.picture(recording)
    labels = {text.get_text() for axes in figure.axes for text in axes.get_legend().get_texts()}
    assert {"link q", "motor θ", "in the gap", "threshold in force"} <= labels
    assert all("[" in axes.get_ylabel() for axes in figure.axes)
    png = io.BytesIO()
    save(figure, png)
    assert png.getvalue().startswith(b"\x89PNG")
    assert len(png.getvalue()) < 150_000


def test_part_cuts_every_array(recording):
    part = recording.part(1.0, 2.0)
    assert len(part.time_s) == len(part.true_q) == len(part.residuals["kalman"]) == 100
    assert part.time_s[0] == pytest.approx(1.0)


def test_pushes_are_felt_surely_and_stop_nothing():
    """Beyond what must be felt, below the collision level and what the motor can hold."""
    c = load_robot(ROMEO).configuration
    joints = {joint.name: joint for joint in c.joints}
    script = pushes(c)
    assert len(script) == 8 + 16
    for push in script:
        joint = joints[push.joint]
        assert 2.0 * joint.thresholds.contact <= abs(push.torque) < joint.thresholds.collision
        assert abs(push.torque) < joint.torque_constant * joint.wiring.max_current_A
    for push in script[:8]:
        assert abs(push.torque) > least_at_rest(joints[push.joint])
    ends = [push.at_s + push.duration_s for push in script]
    assert all(end < push.at_s for end, push in zip(ends, script[1:], strict=False))


def test_runs_cover_all_ticks():
    rows = np.array(["a", "a", "b", "b", "a"])
    time_s = np.arange(5.0)
    assert list(runs(rows, time_s)) == [("a", 0.0, 2.0), ("b", 2.0, 4.0)]
