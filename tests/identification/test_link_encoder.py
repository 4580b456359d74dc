"""Errors of a link's encoder with its turn, apart from gap, bending gear and motor encoder."""

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


def found(log: MotionLog, limits: tuple[float, float] = (-2.5, 2.5)) -> LinkEncoder:
    return link_encoder(log, 0, OFFSET, GEAR, 3.0, limits)


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
def test_what_cannot_be_decided_is_no_correction(log: MotionLog, says: str) -> None:
    one = found(log)
    assert one.harmonics == ()
    assert says in one.reason


def errors(harmonics: tuple[tuple[int, float, float], ...], angle: np.ndarray) -> np.ndarray:
    """Errors [rad] at link positions, beside their mean."""
    all_of_them = np.zeros_like(angle)
    for k, c, s in harmonics:
        all_of_them += c * np.cos(k * (angle - OFFSET)) + s * np.sin(k * (angle - OFFSET))
    return all_of_them - all_of_them.mean()


ECCENTRIC = (1, 0.0012, -0.0009)
WITH_MORE = (ECCENTRIC, (2, -0.0003, 0.0002), (3, 0.0002, 0.0002))


@pytest.mark.parametrize("reach", [1.05, 1.3, 1.6, 1.9])
@pytest.mark.parametrize("true", [(ECCENTRIC,), WITH_MORE])
def test_no_harmonic_from_less_of_a_turn_than_shows_it(
    reach: float, true: tuple[tuple[int, float, float], ...]
) -> None:
    """A third of a turn of an encoder that is off 1 x: fits that take 2 x for it are right where
    the joint was, and wrong elsewhere."""
    one = found(moved(reach, true), (-3.0, 3.0))
    assert one.harmonics == ()
    assert one.reason


@pytest.mark.parametrize("reach", [1.05, 1.4, 2.5, 3.1])
@pytest.mark.parametrize("true", [(ECCENTRIC,), WITH_MORE, ((2, 0.0004, 0.0003),)])
def test_a_correction_is_off_by_no_more_than_stated(
    reach: float, true: tuple[tuple[int, float, float], ...]
) -> None:
    """Also by a harmonic that the model lacks, within the limits."""
    one = found(moved(reach, true), (-reach, reach))
    if one.harmonics:
        place = np.linspace(-reach, reach, 200)
        off = np.abs(errors(one.harmonics, place) - errors(true, place)).max()
        assert off < one.interval + 0.0001
        assert off < np.abs(errors(true, place)).max()
