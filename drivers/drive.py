"""Drive of an arm: its joint, bus address, profile and velocity limits."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, Protocol, TypeVar

import numpy as np

from drivers.counts import Table
from drivers.wiring import JointWiring


class DriveKind(Protocol):
    """Kind of a drive, of any make: a profile of the configuration."""

    @property
    def master_timeout_ms(self) -> int:
        """Master timeout as configured [ms]."""

    @property
    def master_timeout_s(self) -> float:
        """Time without the master after which the drive stops or releases by itself [s]."""

    @property
    def silence_s(self) -> float:
        """Time after which its silence is detected by means other than missing samples [s]; 0 if
        there is none."""

    @property
    def stops_alone(self) -> bool:
        """True if it stops and holds by itself when it no longer receives our frames."""

    @property
    def timeout_reaction(self) -> str:
        """Its reaction when it no longer receives our frames, as text."""

    @property
    def files(self) -> tuple[str, ...]:
        """Files that the profile refers to, relative to the configuration folder."""

    @property
    def sends_motor_position(self) -> bool:
        """True if the motor position is among the samples."""

    @property
    def one_sign(self) -> bool:
        """True if both encoders are in the motor and count in the same direction."""


Measure = Literal["effort", "link_position", "motor_velocity", "target_velocity"]
"""Quantity of a drive; `effort` is its current, or its torque as a current."""
ProfileProblem = tuple[tuple[str | int, ...], str]
"""Location in a profile or joint, and the problem found there."""


@dataclass(frozen=True, slots=True)
class Counts:
    """Integer scale of one quantity in a drive: SI value at the link is gain * counts + bias."""

    at: tuple[str, ...]  # field of the profile that sets the scale
    words: str  # integer type, for messages
    gain: float
    bias: float
    lowest: int
    highest: int


P_co = TypeVar("P_co", bound=DriveKind, covariant=True)


@dataclass(frozen=True, slots=True)
class Drive(Generic[P_co]):
    """One drive with its references resolved: `profile` is the one that `wiring.profile` names."""

    name: str  # of the joint
    wiring: JointWiring
    profile: P_co
    velocity: float  # highest commanded speed, > 0 [rad/s at the link]
    quick_stop: float  # deceleration of its quick stop, > 0 [rad/s2 at the link]
    play: float = 0.0  # between link and motor: full width of the gap [rad]

    @property
    def node(self) -> int:
        """Node ID (CiA 301), or the ID under which another make addresses it."""
        return self.wiring.node

    def __str__(self) -> str:
        return f"node {self.node} ({self.name})"


def harmonics(drives: Sequence[Drive[Any]]) -> Table:
    """Error harmonics of the link encoders (n, k, 3), padded with zeros to the largest count k."""
    given = [[(h.order, h.cosine, h.sine) for h in d.wiring.link_correction] for d in drives]
    table = np.zeros((len(drives), max(map(len, given), default=0), 3))
    for row, rows in zip(table, given, strict=True):
        row[: len(rows)] = np.array(rows).reshape(-1, 3)
    return table
