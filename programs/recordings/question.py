"""Question to recordings, and the answer of one: plain data that can be cached, or sent to another
process or machine."""

from typing import Final

import msgspec

from programs.recordings.settings import Change

ARM: Final = "the arm"
COLLISION: Final = ", collision"  # after a joint's name: the curve of its collision levels


class Question(msgspec.Struct, frozen=True, kw_only=True):
    """Question to all recordings."""

    levels: dict[str, tuple[float, ...]] = {}  # contact levels by joint, ascending [Nm]
    collisions: dict[str, tuple[float, ...]] = {}  # collision levels by joint, ascending [Nm]
    residual: str = ""  # by name; empty: the one that decided
    changes: tuple[Change, ...] = ()
    fresh: bool = False  # the estimator starts afresh, as after switching on
    until_reaction: bool = False  # samples after the first reaction are left out


class Curve(msgspec.Struct, kw_only=True):
    """Counts at each level of one joint, or of the arm."""

    levels: list[float]  # [Nm]; for the arm, the number of each step
    contacts: list[int]
    false: list[int]  # contacts that begin outside of all labels
    beyond_s: list[float]  # time in which a contact lasts
    labels: int = 0
    found: list[int] = []  # labels with a contact in them
    delays_s: list[list[float]] = []  # detection delays of the labels found

    def __add__(self, other: "Curve") -> "Curve":
        """Sum of the counts of two recordings. Raises ValueError for different levels."""
        if self.levels != other.levels:
            raise ValueError("curves over other levels")

        def added(name: str) -> list[int]:
            pairs = zip(getattr(self, name), getattr(other, name), strict=True)
            return [a + b for a, b in pairs]

        return Curve(
            levels=self.levels,
            contacts=added("contacts"),
            false=added("false"),
            beyond_s=added("beyond_s"),  # type: ignore[arg-type]
            labels=self.labels + other.labels,
            found=added("found"),
            delays_s=added("delays_s"),  # type: ignore[arg-type]
        )


class FoundContact(msgspec.Struct, frozen=True):
    """One contact at the levels in force."""

    time_s: float
    joint: str
    torque: float  # residual when it began [Nm]
    threshold: float  # in force then [Nm]


class Answer(msgspec.Struct, kw_only=True):
    """Answer of one recording, or the reason why there is none (`failed`)."""

    file: str
    failed: str = ""
    broken: str = ""  # why the recording ends early, without its name; the intact part counts
    duration_s: float = 0.0
    watched_s: float = 0.0  # time in which contacts are reported, and counted here
    outside_s: float = 0.0  # part of it outside of all labels
    skipped_s: float = 0.0  # left out of a replay, after lost states
    reaction_s: float | None = None
    shares_known: bool = True
    recorded: list[FoundContact] = []  # contacts as recorded
    contacts: list[FoundContact] = []  # contacts with other settings, or by another residual
    recorded_N: float = 0.0  # largest estimated force at the tool, as recorded
    force_N: float = 0.0  # largest estimated force with other settings
    curves: dict[str, Curve] = {}
