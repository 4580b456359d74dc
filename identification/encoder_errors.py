"""Encoder errors that repeat with each turn, as columns of a fit of phi.

An encoder that is mounted off its axis, or whose magnet is not round, deviates to both sides within
each turn: low harmonics, of some 0.5 mrad at the link for a link encoder. Left in phi they look
like borders that move.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from common.arrays import Matrix, Vector

ORDERS = (1, 2)
_LEAST_TURN = 0.25  # of a period; over less of it, a harmonic looks like a straight line
SHOWN = 0.6
"""Share of a period that an angle must turn for a harmonic to be reported: over less, it is
confused with others, the gap and drift, and comes out a multiple of its true size."""
REPORTED = 0.0001
"""Amplitude [rad] at the link above which an error is reported."""


@dataclass(frozen=True, slots=True)
class Harmonic:
    """Error that repeats `order` times with each turn of an encoder."""

    encoder: Literal["link", "motor"]
    order: int
    amplitude: float
    """[rad] at the link: half of its range over the turns that were made"""
    interval: float = 0.0
    """Half the 95 % interval of the amplitude [rad]"""

    def __str__(self) -> str:
        return (f"{self.encoder} encoder off by {1e3 * self.amplitude:.2g} +- "
                f"{1e3 * self.interval:.1g} mrad, {self.order} x per turn")  # fmt: skip


@dataclass(frozen=True, slots=True)
class HarmonicColumns:
    """Columns (N, 2 k) of the harmonics that the motion covers: cosine and sine of each."""

    columns: Matrix
    of: tuple[tuple[Literal["link", "motor"], int], ...]

    shown: tuple[bool, ...]
    """Whether the motion shows the size of each; the others are only fitted alongside"""

    def harmonics(self, solution: Vector, errors: Vector, used: Matrix) -> tuple[Harmonic, ...]:
        """Harmonics worth reporting, from coefficients (2 k,) with standard errors, over the rows
        `used` (M, 2 k)."""
        found = []
        for place, ((encoder, order), shown) in enumerate(zip(self.of, self.shown, strict=True)):
            pair = slice(2 * place, 2 * place + 2)
            size = 0.5 * float(np.ptp(used[:, pair] @ solution[pair]))
            off = 1.96 * float(errors[pair].max())
            if shown and size > max(REPORTED, off):
                found.append(Harmonic(encoder, order, size, off))
        return tuple(found)


def turns(q: Vector, theta: Vector, gear: float) -> HarmonicColumns:
    """Columns for link and motor positions (N,) [rad at the link]; gear: turns of the motor per
    turn of the link, 0 if unknown, then of the link alone."""
    angles: list[tuple[Literal["link", "motor"], Vector]] = [("link", q)]
    if abs(gear) > 1.0:
        angles.append(("motor", gear * theta))
    columns, of, shown = [np.empty((len(q), 0))], [], []
    for encoder, angle in angles:
        turned = float(np.ptp(angle)) / (2.0 * np.pi)
        for order in ORDERS:
            if order * turned < _LEAST_TURN:
                continue
            columns.append(np.stack([np.cos(order * angle), np.sin(order * angle)], axis=1))
            of.append((encoder, order))
            shown.append(turned >= SHOWN)
    return HarmonicColumns(np.concatenate(columns, axis=1), tuple(of), tuple(shown))
