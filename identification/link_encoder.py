"""Error of a link encoder that repeats with its turn, from a motion in which the gear carries.

    phi = q - theta = c + c' t + side alpha - kappa tau_M - skew q_dot + sum over orders of
          cosine_k cos(k a) + sine_k sin(k a)  [+ the motor's, likewise]

at rests of phi, that is at a border of the gap; a is the encoder's angle. Bending by gravity
repeats with the turn, too: hence the column of the torque. A joint that turns by less than
`LEAST_TURN` shows too little of a turn to separate its harmonics from a straight line. Over less
than a turn one harmonic is confused with others, and wrong where the joint has not been: by as much
as it differs there from a fit with more of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from identification.encoder_errors import SHOWN
from identification.gap_result import smoothed
from identification.motion_log import MotionLog

ORDERS = (1, 2)
LEAST_TURN = SHOWN
"""Share of a period of each order that the link must have turned."""
BESIDE = (1, 2, 3)
"""Orders of the fit for comparison."""
_HALF = 0.5  # largest error of the correction within the limits, as a share of it
SMALLEST = 0.0001
"""Least amplitude [rad] that is worth a correction."""
MOST_LEFT = 0.8
"""Largest share of the scatter on held-out motion that a correction may leave."""
_NO_LOAD = 0.1  # [Nm]; what less bends is negligible
_SEPARATES = 1.5
_RESTS = 500
_PLACES = 100
_HELD_OUT = 0.3


@dataclass(frozen=True, slots=True)
class LinkEncoder:
    """Harmonics of one link encoder as (order, cosine, sine) [rad], empty if none is worth a
    correction, with the reason."""

    joint: str
    harmonics: tuple[tuple[int, float, float], ...]
    reason: str
    left: float = float("nan")
    """Scatter of phi at the borders on held-out motion, over that without the harmonics"""
    interval: float = float("nan")
    """Largest error of the correction within the joint's limits [rad]"""

    @property
    def amplitude(self) -> float:
        """Amplitude of the largest harmonic [rad]."""
        return max((float(np.hypot(c, s)) for _, c, s in self.harmonics), default=0.0)


def link_encoder(
    log: MotionLog,
    i: int,
    offset: float,
    gear: float,
    torque_constant: float,
    limits: tuple[float, float],
) -> LinkEncoder:
    """Error of one link encoder; offset [rad]: of its angle, `link_offset`; gear: turns of the
    motor per turn of the link; limits [rad]: range in which a correction has to be right."""
    name = log.joints[i]
    if log.motor_position is None:
        return LinkEncoder(name, (), "no motor position to compare the link's with")
    q, theta, speed = log.link_position[:, i], log.motor_position[:, i], log.motor_velocity[:, i]
    turned = float(np.ptp(np.percentile(q, [1.0, 99.0]))) / (2.0 * np.pi)
    orders = [order for order in ORDERS if order * turned >= LEAST_TURN]
    if not orders:
        about = f"the link turned by {turned:.2f} of a turn, at least {LEAST_TURN / ORDERS[-1]:g}"
        return LinkEncoder(name, (), f"{about}: allow it more range (`limits`)")
    phi = q - theta
    fast = float(np.percentile(np.abs(speed), 95.0))
    phi_dot = np.gradient(smoothed(phi, 3), log.time_s)
    rests = (np.abs(speed) > 0.1 * fast) & (np.abs(phi_dot) < 0.05 * fast)
    if rests.sum() < _RESTS:
        return LinkEncoder(name, (), "phi is hardly ever at rest while the joint moves")
    torque = torque_constant * log.current[:, i]
    rubs = np.sign(speed[rests])
    orders = [k for k in orders if not _hidden(torque[rests], rubs, _turns(q - offset, [k])[rests])]
    if not orders:
        about = "gravity bends the gear as an error of the encoder would: begin from another pose"
        return LinkEncoder(name, (), about)
    plain = _plain(log.time_s, speed, torque)
    motor = _turns(gear * theta, ORDERS)
    link = _turns(q - offset, orders)
    columns = np.concatenate([plain, motor, link], axis=1)[rests]
    found = _judged(name, orders, columns, phi[rests], plain.shape[1] + motor.shape[1])
    if not found.harmonics:
        return found
    beside = np.concatenate([plain, motor, _turns(q - offset, BESIDE)], axis=1)[rests]
    others = _pairs(BESIDE, _fitted(beside, phi[rests])[0][plain.shape[1] + motor.shape[1] :])
    return _within(found, others, (q - offset)[rests], np.linspace(*limits, _PLACES) - offset)


def _within(
    found: LinkEncoder, others: Sequence[tuple[int, float, float]], visited: Vector, reach: Vector
) -> LinkEncoder:
    """`found` with its interval, or refused if it is too uncertain at the angles `reach` (M,)
    [rad], given those `visited`; others: harmonics of the fit for comparison."""
    here, there = (
        np.stack([(own := _at(found.harmonics, a)) - _at(others, a), own]) for a in (visited, reach)
    )
    differ, much = np.abs(there - here.mean(axis=1, keepdims=True)).max(axis=1).tolist()
    if differ <= _HALF * much:
        return replace(found, interval=differ)
    turned = float(np.ptp(visited)) / (2.0 * np.pi)
    about = (f"{turned:.2f} of a turn does not show the harmonics: {1e3 * much:.2g} +- "
             f"{1e3 * differ:.2g} mrad within the limits: move the joint further")  # fmt: skip
    return LinkEncoder(found.joint, (), about, found.left, differ)


def _at(harmonics: Sequence[tuple[int, float, float]], angle: Vector) -> Vector:
    """Error (N,) [rad] at angles of the encoder."""
    coefficients = np.array([pair for _, *pair in harmonics]).ravel()
    return np.asarray(_turns(angle, [order for order, _, _ in harmonics]) @ coefficients)


def _pairs(orders: Sequence[int], solution: Vector) -> tuple[tuple[int, float, float], ...]:
    """Harmonics from these coefficients (2 k, perhaps more)."""
    pairs = solution[: 2 * len(orders)].reshape(-1, 2).tolist()
    return tuple((k, c, s) for k, (c, s) in zip(orders, pairs, strict=True))


def _plain(time_s: Vector, speed: Vector, torque: Vector) -> Matrix:
    t = (time_s - time_s.mean()) / max(float(np.ptp(time_s)), 1.0)
    return np.stack([np.ones_like(t), t, -speed, -torque], axis=1)


def _turns(angle: Vector, orders: Sequence[int]) -> Matrix:
    pairs = [(np.cos(order * angle), np.sin(order * angle)) for order in orders]
    return np.stack([column for pair in pairs for column in pair], axis=1)


def _hidden(torque: Vector, rubs: Vector, columns: Matrix) -> bool:
    """True if a part of the torque (M,) repeats with the turn like these columns, and the rest,
    besides friction with the sign `rubs` (M,), is too little to show how the gear bends."""
    X = np.concatenate([np.ones((len(torque), 1)), rubs[:, None], columns], axis=1)
    solution = np.linalg.lstsq(X, torque, rcond=None)[0]
    repeats, left = columns @ solution[2:], torque - X @ solution
    return bool(repeats.std() > max(_NO_LOAD, _SEPARATES * left.std()))


def _judged(
    name: str, orders: Sequence[int], columns: Matrix, phi: Vector, known: int
) -> LinkEncoder:
    """Harmonics fitted to all rests, if a fit to the first part holds on the last."""
    cut = round((1.0 - _HELD_OUT) * len(phi))
    first, last = slice(0, cut), slice(cut, len(phi))
    with_them, side = _fitted(columns, phi)
    sides = np.concatenate([columns, side[:, None]], axis=1)
    few = np.concatenate([columns[:, :known], side[:, None]], axis=1)
    left = _tried(sides, phi, first, last) / max(_tried(few, phi, first, last), 1e-9)
    found = LinkEncoder(name, _pairs(orders, with_them[known:]), "", left)
    if found.amplitude < SMALLEST:
        return LinkEncoder(name, (), f"less than {1e3 * SMALLEST:g} mrad", left)
    if not left < MOST_LEFT:
        about = (f"would leave {left:.0%} of the scatter of phi at the borders on held-out motion, "
                 f"at most {MOST_LEFT:.0%}")  # fmt: skip
        return LinkEncoder(name, (), about, left)
    return found


def _fitted(columns: Matrix, phi: Vector) -> tuple[Vector, NDArray[np.float64]]:
    """Coefficients of the columns and of the gap's side, and that side (M,), +-1."""
    level = 0.5 * float(np.percentile(phi, 2.0) + np.percentile(phi, 98.0))
    side = np.where(phi > level, 1.0, -1.0)
    solution = np.zeros(columns.shape[1] + 1)
    for _ in range(30):
        both = np.concatenate([columns, side[:, None]], axis=1)
        before, solution = solution, np.linalg.lstsq(both, phi, rcond=None)[0]
        side = np.where(phi - columns @ solution[:-1] > 0.0, 1.0, -1.0)
        if np.allclose(before, solution, rtol=1e-9, atol=1e-12):
            break
    return solution, side


def _tried(columns: Matrix, phi: Vector, first: slice, last: slice) -> float:
    """Scatter [rad] of the errors in the last rows, by a fit to the first."""
    solution = np.linalg.lstsq(columns[first], phi[first], rcond=None)[0]
    left = phi[last] - columns[last] @ solution
    return 1.4826 * float(np.median(np.abs(left - np.median(left))))
