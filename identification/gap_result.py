"""Result of a gap identification, by any of the methods."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from common.arrays import Vector
from identification.encoder_errors import Harmonic

ENCODERS = 3e-5  # [rad], their error that no scatter shows
SMALLEST = 0.001
"""A half-gap below this [rad] is none: encoders' errors and the gear's own bending are as large."""
CROSSINGS = 15
"""Number of changes between plateaus below which no value is given."""
CLEAR = 0.15
"""Scatter of the plateaus, as a share of alpha, beyond which they are not borders."""
ONE_BORDER = "only one border was met, or there is no gap: move the link by hand"

_SAME = 1e-9  # [rad]; closer values are the same value of an encoder, rounded differently


class GapVerdict(StrEnum):
    """Verdict on a joint's gap; only `clear` and `none` come with a half-gap to use."""

    CLEAR = "clear"
    NONE = "no dead zone"
    UNCLEAR = "no clear dead zone"
    FEW = "too few crossings"
    ONE_BORDER = "one border only"
    TOO_SHORT = "the motor turned too little"
    MOTOR_MOVED = "the motor moved"
    NO_LINK_ENCODER = "no link encoder"
    NO_MOTION = "nothing moved"


@dataclass(frozen=True, slots=True, kw_only=True)
class GapResult:
    """Result for one joint. half_gap is NaN unless the verdict is `clear`; it is 0 for `none`. A
    refused value is kept as `estimate`, to be shown, never used."""

    joint: str
    verdict: GapVerdict
    reason: str
    """Explanation with the figures."""
    half_gap: float = float("nan")
    """alpha [rad]"""
    confidence: float = float("nan")
    """Half width of the 95 % interval of alpha [rad]"""
    estimate: float = float("nan")
    """alpha [rad] that the verdict refused"""
    limit: "Limit | None" = None
    """Limit that the estimate exceeded"""
    compliance: float = float("nan")
    """of the gear [rad/Nm], from a hand that pressed with different forces"""
    crossings: int = 0
    skew_s: float = float("nan")
    """Delay of the link encoder behind the motor's [s]; NaN if it does not show"""
    harmonics: tuple[Harmonic, ...] = ()
    """Encoder errors that repeat with each turn, as the motion shows them"""
    coulomb: float = float("nan")
    """Friction inside the gap [Nm], from ramps only"""
    stiffness: float = float("nan")
    """Stiffness of the border [Nm/rad], from ramps only"""

    @property
    def usable(self) -> bool:
        """True if `half_gap` may be used in a configuration."""
        return self.verdict in (GapVerdict.CLEAR, GapVerdict.NONE)


@dataclass(frozen=True, slots=True)
class Limit:
    """Limit that a credible gap keeps, and the usual cause if it does not."""

    name: str
    value: float
    most: float
    unit: str
    cause: str

    @property
    def kept(self) -> bool:
        """True if the value is within its limit; False for NaN."""
        return self.value <= self.most

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.name} {self.value:.3g}{unit}, at most {self.most:.3g}{unit}: {self.cause}"


def refused(found: GapResult, verdict: GapVerdict, limits: Sequence[Limit]) -> GapResult:
    """`found` if it keeps all limits; else its value as an estimate, with the first one
    exceeded."""
    broken = next((limit for limit in limits if not limit.kept), None)
    if broken is None:
        return found
    return replace(found, verdict=verdict, half_gap=float("nan"), estimate=found.half_gap,
                   limit=broken, reason=f"{found.reason}; {broken}")  # fmt: skip


def spread(values: Vector) -> float:
    """Range between the 1st and the 99th percentile."""
    low, high = np.percentile(values, [1.0, 99.0])
    return float(high - low)


def resolution(values: Vector) -> float:
    """Resolution of an encoder, the smallest step between two of its values; 0 for only one."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > _SAME]
    return float(steps.min()) if len(steps) else 0.0


def smoothed(values: Vector, width: int) -> Vector:
    """Moving average over `width` samples; the values at the ends are repeated."""
    if width < 2:
        return values
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    return np.asarray(np.convolve(padded, np.full(width, 1.0 / width), mode="valid"))
