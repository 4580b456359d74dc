"""What a link's encoder errs with its turn, told from gap, bending gear and the motor's encoder."""

import numpy as np
import pytest

from identification.link_encoder import LinkEncoder, link_encoder
from identification.motion_log import MotionLog

T = 0.01
GEAR, ALPHA, KAPPA = 100.0, 0.006, 0.0008
OFFSET = 0.7


def moved(
    reach: float, harmonics: tuple[tuple[int, float, float], ...], gravity: float = 0.05
) -> MotionLog:
    """120 s of one joint with gravity [Nm], a gap, a bending gear, noise, and both encoders off."""
    t = T * np.arange(12000)
    angle = reach * (0.8 * np.sin(2 * np.pi * t / 60.0) + 0.2 * np.sin(2 * np.pi * t / 7.0))
    speed = np.gradient(angle, T)
    torque = gravity * np.sin(angle) + 0.8 * np.tanh(speed / 0.005)
    theta = angle + ALPHA * np.tanh(torque / 0.02) + KAPPA * torque
    seen = angle + sum(
        c * np.cos(k * (angle - OFFSET)) + s * np.sin(k * (angle - OFFSET)) for k, c, s in harmonics
    )
    theta_seen = theta + 0.0005 * np.sin(GEAR * theta)
    noise = np.random.default_rng(2).standard_normal((2, len(t)))
    columns = (torque / 3.0 + 0.01 * noise[0], seen, np.gradient(theta, T) + 0.001 * noise[1])
    return MotionLog(("joint",), t, *(x[:, None] for x in columns), theta_seen[:, None])


def found(log: MotionLog) -> LinkEncoder:
    return link_encoder(log, 0, OFFSET, GEAR, 3.0)


@pytest.mark.parametrize(
    ("reach", "harmonics"),
    [
        (2.5, ((1, 0.0006, -0.0004), (2, -0.0003, 0.0005))),
        (1.4, ((2, 0.0004, 0.0003),)),  # less than half a turn
    ],
)
def test_harmonics_as_they_are(
    reach: float, harmonics: tuple[tuple[int, float, float], ...]
) -> None:
    one = found(moved(reach, harmonics))
    assert [order for order, _, _ in one.harmonics] == [order for order, _, _ in harmonics]
    for (_, *mine), (_, *true) in zip(one.harmonics, harmonics, strict=True):
        assert mine == pytest.approx(true, abs=0.0001)
    assert one.reason == ""


@pytest.mark.parametrize(
    ("log", "says"),
    [
        (moved(0.5, ((1, 0.0005, 0.0),)), "of a turn, at least 0.3"),
        (moved(2.5, ()), "less than 0.1 mrad"),
        (moved(1.4, ((2, 0.0005, 0.0),), 5.0), "gravity bends the gear as"),
        (MotionLog(("joint",), *(getattr(moved(2.5, ()), name) for name in
         ("time_s", "current", "link_position", "motor_velocity"))), "no motor position"),
    ],
)  # fmt: skip
def test_what_cannot_be_told_is_no_correction(log: MotionLog, says: str) -> None:
    one = found(log)
    assert one.harmonics == ()
    assert says in one.reason
