"""Link and rotor slower than their velocities resolve: bounds of phi, and its uncertainty."""

import numpy as np
import pytest

from estimator.motor_position import Side
from estimator.settings import GapSettings
from tests.estimator.one_joint import ALPHA, Joint, T

COUNT = 2.0 * np.pi / 2**17
TICKS = 4000


def seen(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions by an encoder of 17 bit, and a mean velocity that its counts do not disturb."""
    counted = COUNT * np.round(q / COUNT)
    return counted, np.clip(np.gradient(q, T), -0.009, 0.009)


@pytest.mark.parametrize("speed", [0.001, -0.001, 0.005, -0.005])
@pytest.mark.parametrize("who", ["both", "link"])
@pytest.mark.parametrize("there_and_back", [False, True])
def test_a_joint_that_creeps_is_never_wrong_and_sure(
    speed: float, who: str, there_and_back: bool
) -> None:
    # The rotor leans on the lower border. Then its load is no more than friction may be, and the
    # link creeps: with its rotor, or alone, by a hand, until it meets the other border.
    time_s = T * np.arange(1, TICKS + 1)
    q = speed * (10.0 - np.abs(time_s % 20.0 - 10.0)) if there_and_back else speed * time_s
    joint = Joint()
    joint.settle(2.0)
    furthest = joint.sigma + np.abs(q).max()
    phi, before, unknown = -ALPHA, 0.0, 0
    for here, measured, q_dot in zip(q, *seen(q), strict=True):
        joint.step(q=measured, q_dot=q_dot, torque=0.4)
        if who == "link":
            phi = min(max(phi + here - before, -ALPHA), ALPHA)
        before = here
        if joint.side == Side.UNKNOWN:
            unknown += 1
            continue
        error = measured - float(joint.position.theta[0]) - phi
        assert abs(error) <= joint.sigma + 2.0 * COUNT
        assert joint.side != Side.GAP or abs(phi) < ALPHA
    # What has crept far is not known; and nothing but a load makes it known again.
    assert abs(furthest - ALPHA) > 0.1 * ALPHA
    assert (unknown > 0) == (furthest > ALPHA)


def test_counts_of_an_encoder_are_no_creep() -> None:
    rng = np.random.default_rng(2)
    joint = Joint()
    joint.settle(2.0)
    sigma = joint.sigma
    for count in rng.integers(-1, 2, 10_000):
        joint.step(q=count * COUNT, q_dot=0.009 * count)
    assert joint.sigma <= sigma + 2.0 * COUNT
    assert joint.side == Side.LEFT


def test_a_load_shows_the_side_and_from_there_creep_counts_anew() -> None:
    joint = Joint()
    joint.settle(2.0)
    at_border = joint.sigma
    for k in range(500):  # 10 mrad away
        joint.step(q=2e-5 * k, q_dot=0.002)
    assert joint.sigma == pytest.approx(at_border + 0.01, abs=1e-4)
    for _ in range(40):
        joint.step(q=0.01, torque=2.0)
    assert joint.sigma == pytest.approx(at_border, rel=0.01)
    for k in range(250):  # half of the way back
        joint.step(q=0.01 - 2e-5 * k, q_dot=-0.002)
    assert joint.sigma == pytest.approx(at_border + 0.005, abs=1e-4)


def test_after_a_motion_creep_counts_from_where_it_ended() -> None:
    joint = Joint(GapSettings(compliance=0.0, velocity_bias=0.0, velocity_scale_error=0.0))
    joint.settle(2.0)
    before = joint.sigma
    for k in range(100):
        joint.step(q=0.1 * T * k, q_dot=0.1, w=0.1)
    for _ in range(100):
        joint.step(q=0.1 * T * 99)
    assert joint.sigma == pytest.approx(before, abs=1e-9)
