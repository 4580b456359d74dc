"""Drive of an arm: the joint that it turns, its place on the bus, its kind, its speeds."""

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
        """The same, as configured [ms]."""

    @property
    def patience_s(self) -> float:
        """Time without us after which the drive stops, or lets go, by itself [s]."""

    @property
    def silence_s(self) -> float:
        """Time after which its silence is noticed by other than missing samples [s]; 0 where there
        is no other."""

    @property
    def stops_alone(self) -> bool:
        """True where it stops and holds when nothing of ours reaches it."""

    @property
    def without_us(self) -> str:
        """Its reaction when nothing of ours reaches it, in words."""

    @property
    def files(self) -> tuple[str, ...]:
        """Files that it refers to, relative to the configuration."""

    @property
    def sends_motor_position(self) -> bool:
        """True where the position of the motor is among the samples."""

    @property
    def one_sign(self) -> bool:
        """True where both encoders are in the motor, and count the same way."""


Measure = Literal["effort", "link_position", "motor_velocity", "target_velocity"]
"""Quantity of a drive; `effort` is its current, or its torque as a current."""
ProfileProblem = tuple[tuple[str | int, ...], str]
"""Place in a profile, or in a joint, and what is wrong there."""


@dataclass(frozen=True, slots=True)
class Counts:
    """Integers of one quantity in a drive: gain * counts + bias is its SI value at the link."""

    at: tuple[str, ...]  # field of the profile that scales them
    words: str  # their type, for messages
    gain: float
    bias: float
    lowest: int
    highest: int


P_co = TypeVar("P_co", bound=DriveKind, covariant=True)


@dataclass(frozen=True, slots=True)
class Drive(Generic[P_co]):
    """One drive, resolved: `profile` is what `wiring.profile` names."""

    name: str  # of the joint
    wiring: JointWiring
    profile: P_co
    velocity: float  # highest commanded speed, > 0 [rad/s at the link]
    quick_stop: float  # deceleration of its quick stop, > 0 [rad/s2 at the link]
    play: float = 0.0  # of its link about its motor: width of the gap [rad]

    @property
    def node(self) -> int:
        """Its node id (CiA 301), or the id by which another make calls it."""
        return self.wiring.node

    def __str__(self) -> str:
        return f"node {self.node} ({self.name})"


def harmonics(drives: Sequence[Drive[Any]]) -> Table:
    """Errors of the link encoders (n, k, 3), k the most that one joint has; zeros fill it up."""
    given = [[(h.order, h.cosine, h.sine) for h in d.wiring.link_correction] for d in drives]
    table = np.zeros((len(drives), max(map(len, given), default=0), 3))
    for row, rows in zip(table, given, strict=True):
        row[: len(rows)] = np.array(rows).reshape(-1, 3)
    return table
