"""Many ticks at once are those ticks one by one, to the last bit."""

from typing import Any

import numpy as np
import pytest

from common.errors import ModelError
from estimator.estimate import SampleRows
from estimator.estimator import Estimator
from tests.estimator.golden import BESIDE, T, arrivals

VECTORS = ("q", "q_dot", "theta", "phi", "phi_sigma", "tau_M", "threshold", "thresholded", "side")


def sampled(motion: Any, ticks: int) -> SampleRows:
    """Some missing, one not finite, one tick late; a push that is felt."""
    interval_s = np.full(ticks, T)
    interval_s[70:71] = 3 * T
    current = motion.current[:ticks].copy()
    current[100:130, 1] += 1.0  # what moves nothing is a touch
    current[150:151, 2], current[:1, 1] = np.nan, np.inf
    return SampleRows(
        current=current,
        link_position=motion.q[:ticks],
        motor_velocity=motion.theta_dot[:ticks],
        motor_position=motion.theta[:ticks],
        fresh=arrivals(ticks),
        interval_s=interval_s,
    )


@pytest.mark.parametrize("source", ["integrated", "measured"])
@pytest.mark.parametrize("batch", [1, 7, 400])
def test_they_are(make_estimator, pushed_motion, source: str, batch: int) -> None:
    ticks, resets = 400, {60, 205}
    at_once, one_by_one = (make_estimator(motor_position=source, beside=BESIDE) for _ in range(2))
    samples, links = sampled(pushed_motion, ticks), set()
    for begin in range(0, ticks, batch):
        part = slice(begin, begin + batch)
        made = at_once.run(
            SampleRows(*(getattr(samples, name)[part] for name in SampleRows.__slots__)),
            [k - begin for k in resets if begin <= k < begin + batch],
        )
        for row, k in enumerate(range(begin, min(begin + batch, ticks))):
            expected = step(one_by_one, samples, k)
            for name in (*VECTORS, "residual"):
                found = getattr(made, name)[row]
                np.testing.assert_array_equal(found, getattr(expected, name), f"{name} {k}")
            for name, residual in expected.beside.items():
                np.testing.assert_array_equal(made.beside[name][row], residual, f"{name} {k}")
            assert made.flags[row] == int(expected.flags), k
            link = made.touched_link[row]
            assert (at_once.model.names[link] if link >= 0 else "") == expected.touched_link, k
            links.add(expected.touched_link)
            if k in resets:
                one_by_one.reset()
    assert len(links) > 1
    assert at_once.memory() == one_by_one.memory()


def step(estimator: Estimator, samples: SampleRows, k: int) -> Any:
    return estimator.step(
        samples.current[k],
        samples.link_position[k],
        samples.motor_velocity[k],
        samples.motor_position[k],
        float(samples.interval_s[k]),
        fresh=samples.fresh[k],
    )


def test_rows_of_another_arm_are_refused(make_estimator, pushed_motion) -> None:
    samples = sampled(pushed_motion, 10)
    other = SampleRows(
        samples.current[:, :3], *(getattr(samples, n) for n in SampleRows.__slots__[1:])
    )
    with pytest.raises(ModelError, match=r"current is \(10, 3\); it must be"):
        make_estimator().run(other)


@pytest.mark.parametrize("name", SampleRows.__slots__)
@pytest.mark.parametrize("ticks", [9, 11])
def test_columns_of_another_length_are_refused(
    make_estimator, pushed_motion, name: str, ticks: int
) -> None:
    """Compiled loops would read, and write, beyond their ends."""
    parts = {field: getattr(sampled(pushed_motion, 200), field) for field in SampleRows.__slots__}
    rows = {field: part[: ticks if field == name else 10] for field, part in parts.items()}
    with pytest.raises(ModelError, match="it must be an array of shape"):
        make_estimator().run(SampleRows(**rows))


def test_one_sample_does_not_stand_for_all_joints(make_estimator, pushed_motion) -> None:
    samples = [getattr(pushed_motion, name)[0] for name in ("current", "q", "theta_dot", "theta")]
    with pytest.raises(ModelError, match=r"fresh is \(1,\)"):
        make_estimator().step(*samples, fresh=np.ones(1, dtype=bool))
