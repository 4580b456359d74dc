"""Gap state in a log of a gear that bends: what is bent is no way through the gap."""

from dataclasses import replace

import numpy as np
import pytest

from identification.log_intervals import Intervals, locate, play

ALPHA, COMPLIANCE, PERIOD = 0.004, 0.0022, 0.01  # [rad], [rad/Nm], [s]
TIME = PERIOD * np.arange(1, 3001)


def bent(
    arm, torque: np.ndarray, late: float = 0.0, masses_off: float = 0.0, rubs: float = 0.0
) -> Intervals:
    """Joint 0, whose gear carries torque (N,) [Nm] and meets the border that it pushes at; the
    others are free of load. Its link encoder is late [s], its model's masses are off by torque
    [Nm], its rotor `rubs` by so much more than is known [Nm]."""
    n = arm.transmission.n
    zero = np.zeros((len(TIME), n))
    load, ends = zero.copy(), np.zeros((len(TIME), 5, n))
    load[:, 0] = torque + masses_off * np.cos(TIME)
    ends[:, 0, 0] = np.sin(1.3 * TIME - 1.3 * late)
    ends[:, 1, 0] = 1.3 * np.cos(1.3 * TIME - 1.3 * late)
    # theta runs ahead of the link by the half-gap, and by what the gear bends.
    ends[:, 4, 0] = np.sin(1.3 * TIME) + ALPHA * np.sign(torque) + COMPLIANCE * torque
    moved = torque + rubs * np.tanh(ends[:, 1, 0] / 0.01)
    ends[:, 2, 0] = moved / arm.transmission.torque_constant[0]
    return Intervals(
        time_s=TIME, dt=np.full(len(TIME), PERIOD), first=TIME < 1.5 * PERIOD, inertial=load,
        current=ends[:, 2], gravity=load, q=zero, q_dot=zero, theta_dot=zero, theta_ddot=zero,
        advance=np.diff(ends[:, 4], axis=0, prepend=ends[:1, 4]), measured=True, ends=ends,
        asked=zero,
    )  # fmt: skip


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_gear_that_bends_at_one_border_has_not_met_the_other(arm, sign):
    """Two half-gaps of bending: as wide as the gap, and none of it."""
    rows = bent(arm, sign * (2.0 + 1.8 * np.sin(TIME)))
    known = replace(arm.transmission, half_gap=np.full(arm.transmission.n, ALPHA))
    found = locate(rows, known, arm.configuration.estimator)
    assert found.gap[:, 0].mean() < 0.1


def test_the_middle_of_a_gap_is_where_it_is_however_much_more_one_side_bears(arm):
    torque = np.where(np.sin(TIME) > -0.3, 2.5 + 1.5 * np.sin(7.0 * TIME), -0.3)
    known = replace(arm.transmission, half_gap=np.full(arm.transmission.n, ALPHA))
    found = locate(bent(arm, torque), known, arm.configuration.estimator)
    unbent = found.phi[:, 0] + COMPLIANCE * torque
    assert np.abs(unbent) == pytest.approx(np.full(len(TIME), ALPHA), rel=0.1)


@pytest.mark.parametrize("measured", [True, False])
def test_what_a_motor_goes_while_samples_are_missing_is_no_play(arm, measured):
    """A quarter of them, in bursts of 0.37 s, of a joint that moves 1 rad and has no gap."""
    rows, there = bent(arm, np.zeros_like(TIME)), (np.arange(len(TIME)) // 37) % 4 != 0
    theta = 0.5 * np.sin(TIME)[:, None] * np.ones(arm.transmission.n)
    ends = rows.ends.copy()
    ends[:, 0], ends[:, 4] = theta, theta if measured else 0.0
    advance = np.diff(theta, axis=0, prepend=0.0)
    left = {name: getattr(rows, name)[there] for name in ("time_s", "dt", "inertial")}
    first = np.diff(left["time_s"], prepend=0.0) > 1.5 * PERIOD
    gone = replace(rows, **left, first=first, advance=advance[there], ends=ends[there],
                   measured=measured)  # fmt: skip
    assert play(gone, np.zeros(arm.transmission.n)).max() < 1e-6


@pytest.mark.parametrize(
    ("late", "masses_off", "rubs"),
    [(0.0, 0.0, 0.0), (0.005, 0.0, 0.0), (0.0, 1.0, 0.0), (-0.003, 1.0, 0.0), (0.0, 0.0, 0.3)],
)
def test_neither_a_late_encoder_nor_other_masses_make_a_way_through_the_gap(
    arm, late, masses_off, rubs
):
    torque = 2.0 * np.sin(TIME) + 0.5 * np.sin(2.7 * TIME)
    known = replace(arm.transmission, half_gap=np.full(arm.transmission.n, ALPHA))
    rows = bent(arm, torque, late, masses_off, rubs)
    found = locate(rows, known, arm.configuration.estimator)
    assert found.late[0] == pytest.approx(late, abs=1e-4)
    assert found.gap[:, 0].mean() < 0.05
    assert play(rows, found.late)[0] < 2.0 * ALPHA + 0.004
