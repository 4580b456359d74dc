"""Logs of several sittings, between which a link moved unseen."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from common.errors import LogError
from identification.log_checks import refuse_implausible
from identification.motion_log import MotionLog

T = 0.01 * np.arange(1000)
Q = 0.2 * np.sin(0.5 * np.pi * T)


def sittings(*offsets: float, sign: float = 1.0) -> MotionLog:
    """The same motion, from another place each time [rad]; the motor's velocity has a bias."""
    time_s = np.concatenate([T + 20.0 * k for k in range(len(offsets))])
    q = np.concatenate([Q + offset for offset in offsets])
    velocity = np.tile(sign * np.gradient(Q, T) + 0.002, len(offsets))
    columns = (np.zeros_like(q), q, velocity)
    return MotionLog(("j",), time_s, *(one[:, None] for one in columns))


@pytest.mark.parametrize("offsets", [(0.0,), (0.0, 1.4), (0.7, -0.7, 0.7)])
def test_a_link_that_moved_between_sittings_is_no_wrong_sign(offsets: tuple[float, ...]) -> None:
    refuse_implausible(sittings(*offsets), np.array([1.0]))
    with pytest.raises(LogError, match="link and motor of j do not move together"):
        refuse_implausible(sittings(*offsets, sign=-1.0), np.array([1.0]))


@pytest.mark.parametrize(
    ("positions", "velocities", "said"),
    [(1.0, 0.0, "motor_velocity of j is the same throughout, while its link moves by 0.4 rad"),
     (0.0, 1.0, "link_position of j is the same throughout, while its motor moves by 0.4 rad"),
     (57.3, 57.3, "j moves by 22.* rad, .* in degrees, or the motor's"),
     (57.3, 1.0, "j moves 57.* times as far as its motor: units wrong")],
)  # fmt: skip
def test_the_unit_or_column_that_is_wrong_is_named(
    positions: float, velocities: float, said: str
) -> None:
    velocity = velocities * np.gradient(Q, T)
    columns = (np.zeros_like(Q), positions * Q, velocity)
    log = MotionLog(("j",), T, *(one[:, None] for one in columns))
    with pytest.raises(LogError, match=said):
        refuse_implausible(log, np.array([1.0]))


def test_a_log_that_is_too_slow_is_reported_to_be_faster() -> None:
    t = 0.1 * np.arange(400)
    q = 0.2 * np.sin(0.5 * np.pi * t)
    columns = (np.zeros_like(q), q, np.gradient(q, t))
    log = MotionLog(("j",), t, *(one[:, None] for one in columns))
    with pytest.raises(LogError, match=r"every 100 ms, at most 80 .* log faster"):
        refuse_implausible(log, np.array([1.0]))


def measured(
    velocities: float, positions: float = 1.0, *, late: int = 0, step: float = 0.0
) -> MotionLog:
    """A motor whose position is logged, too; its velocity late, and cut off to steps [rad/s]."""
    velocity = velocities * np.gradient(Q, T)
    velocity = np.concatenate([np.full(late, velocity[0]), velocity[: len(velocity) - late]])
    velocity = step * np.trunc(velocity / step) if step else velocity
    columns = (np.zeros_like(Q), Q, velocity, positions * Q)
    return MotionLog(("j",), T, *(one[:, None] for one in columns))


@pytest.mark.parametrize(
    ("scales", "said"),
    [((1.5, 1.0), r"motor_velocity of j is 1.5 times .* scale of `motor_velocity`"),
     ((0.6, 1.0), r"motor_velocity of j is 0.6 times .* scale of `motor_velocity`"),
     ((0.88, 1.0), r"motor_velocity of j is 0.88 times .* scale of `motor_velocity`"),
     ((1.0, 1.25), r"motor_velocity of j is 0.8 times .* scale of `motor_position`")],
)  # fmt: skip
def test_a_velocity_that_is_not_the_change_of_its_position_is_named(
    scales: tuple[float, float], said: str
) -> None:
    with pytest.raises(LogError, match=said):
        refuse_implausible(measured(*scales), np.array([1.0]))


@pytest.mark.parametrize("how", [{}, {"late": 5}, {"step": 0.02}, {"late": 3, "step": 0.01}])
def test_late_and_coarse_velocities_are_no_wrong_scale(how: dict[str, Any]) -> None:
    refuse_implausible(measured(1.0, **how), np.array([1.0]))
    refuse_implausible(measured(0.95, late=3), np.array([1.0]))


def one_off(values: np.ndarray, by: float) -> np.ndarray:
    return np.where(np.arange(len(values)) == 400, values + by, values)


@pytest.mark.parametrize(
    ("change", "column", "said"),
    [
        (lambda q: one_off(q, 1e6), "link", r"jumps by 1e\+06 rad at 4 s and back: a bad sample"),
        (lambda q: one_off(q, 1.0), "link", r"jumps by 1 rad at 4 s and back: a bad sample"),
        (lambda q: one_off(q, 0.2), "motor", r"jumps by 0.2 rad at 4 s and back: a bad sample"),
        (lambda q: (q + 6.2) % (2.0 * np.pi), "link", r"jumps by 6.28.*5 times more: .* wraps"),
        (lambda q: (q + 0.9) % 1.0, "link", r"jumps by 1 rad .*: an encoder that wraps"),
        (lambda q: (q + 0.03) % 0.0628, "motor", r"jumps by 0.0628 rad .*: an encoder that wraps"),
        (lambda q: q + 0.8 * (T > 5.0), "link", r"jumps by 0.8 rad at 5.* lose its position"),
    ],
)
def test_a_position_that_jumps_is_named_with_its_cause(
    change: Callable[[np.ndarray], np.ndarray], column: str, said: str
) -> None:
    log = measured(1.0)
    changed = {f"{column}_position": change(Q)[:, None]}
    with pytest.raises(LogError, match=f"^{column}_position of j {said}"):
        refuse_implausible(replace(log, **changed), np.array([1.0]))


def test_a_link_that_snaps_and_a_motor_that_stops_at_once_do_not_jump() -> None:
    """Samples every 80 ms: the link through 0.2 rad of gap in one, the velocity late."""
    t = 0.08 * np.arange(1000)
    theta = np.abs((0.7 * t) % 2.8 - 1.4)
    late = np.concatenate([[0.0], np.diff(theta) / 0.08])[:-1]
    columns = (0.0 * t, theta + 0.2 * (np.sin(t) > 0.0), np.append(0.0, late), theta)
    refuse_implausible(MotionLog(("j",), t, *(one[:, None] for one in columns)), np.array([1.0]))


@pytest.mark.parametrize(
    ("peak", "said"),
    [(6.2, r"reaches 6.2 A, its drive gives 4 A: is `max_current_A` its peak current"),
     (687.0, r"reaches 687 A, its drive gives 4 A: unit wrong by 1000 \(mA"),
     (4000.0, r"unit wrong by 1000")],
)  # fmt: skip
def test_a_current_beyond_what_its_drive_gives_is_reported_by_how_far(
    peak: float, said: str
) -> None:
    log = replace(measured(1.0), current=peak * Q[:, None] / Q.max())
    with pytest.raises(LogError, match=said):
        refuse_implausible(log, np.array([4.0]))


@pytest.mark.parametrize("position", [True, False])
@pytest.mark.parametrize(("every", "missing"), [(37, 9), (100, 60), (148, 90), (300, 90)])
def test_rows_that_are_missing_swap_no_joints(every: int, missing: int, *, position: bool) -> None:
    there = np.arange(len(T)) % every >= missing
    whole = measured(1.0)
    columns = [x[there] for x in (whole.current, whole.link_position, whole.motor_velocity)]
    columns += [whole.link_position[there]] if position else []
    log = MotionLog(("j",), T[there], *columns)
    refuse_implausible(log, np.array([1.0]))
    with pytest.raises(LogError, match="do not move together"):
        refuse_implausible(replace(log, link_position=-log.link_position), np.array([1.0]))
