"""Result of a gap identification, by any of the methods."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from common.arrays import Vector
from identification.encoder_errors import Harmonic

ENCODERS = 3e-5  # [rad]: what no scatter shows of them
SMALLEST = 0.001
"""A half-gap below this [rad] is none: encoders and the gear's own bending are of that size."""
CROSSINGS = 15
"""Differences between plateaus below which no figure is given."""
CLEAR = 0.15
"""Scatter of the plateaus, as a share of alpha, beyond which they are no borders."""
ONE_BORDER = "only one border was met, or there is no gap: move the link by hand"

_SAME = 1e-9  # [rad]: closer ones are one value of an encoder, rounded otherwise


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
    """Result for one joint. half_gap is NaN unless the verdict is `clear`; it is 0 for `none`. What
    was refused keeps its figure as `estimate`, to be shown, never used."""

    joint: str
    verdict: GapVerdict
    reason: str
    """Explanation with the figures."""
    half_gap: float = float("nan")
    """alpha [rad]"""
    confidence: float = float("nan")
    """Half width of the 95 % interval of alpha [rad]"""
    estimate: float = float("nan")
    """alpha [rad] as it would be, where the verdict refuses it"""
    limit: "Limit | None" = None
    """Limit that the estimate exceeded"""
    compliance: float = float("nan")
    """of the gear [rad/Nm], by a hand that pressed now more, now less"""
    crossings: int = 0
    skew_s: float = float("nan")
    """Delay of the link encoder behind the motor's [s]; NaN where it does not show"""
    harmonics: tuple[Harmonic, ...] = ()
    """Errors of the encoders that repeat with a turn, as motion shows them"""
    coulomb: float = float("nan")
    """Friction inside the gap [Nm], from ramps only"""
    stiffness: float = float("nan")
    """Stiffness of the border [Nm/rad], from ramps only"""

    @property
    def usable(self) -> bool:
        """True where `half_gap` may go into a configuration."""
        return self.verdict in (GapVerdict.CLEAR, GapVerdict.NONE)


@dataclass(frozen=True, slots=True)
class Limit:
    """Limit of a figure that a gap to be believed keeps, and what usually breaks it."""

    name: str
    value: float
    most: float
    unit: str
    cause: str

    @property
    def kept(self) -> bool:
        """False also where the figure is not a number."""
        return self.value <= self.most

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.name} {self.value:.3g}{unit}, at most {self.most:.3g}{unit}: {self.cause}"


def refused(found: GapResult, verdict: GapVerdict, limits: Sequence[Limit]) -> GapResult:
    """`found` where it keeps all limits; else its figure as an estimate, with the first limit that
    it breaks."""
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
    """Step of an encoder, the smallest between two of its values; 0 of one value."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > _SAME]
    return float(steps.min()) if len(steps) else 0.0


def smoothed(values: Vector, width: int) -> Vector:
    """Mean over `width` samples around each; the ends repeat."""
    if width < 2:
        return values
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    return np.asarray(np.convolve(padded, np.full(width, 1.0 / width), mode="valid"))
