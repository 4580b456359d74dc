"""Question to recordings, and the answer of one: plain data that can be sent to another process or
machine, and kept."""

from typing import Final

import msgspec

from programs.recordings.settings import Change

ARM: Final = "the arm"
COLLISION: Final = ", collision"  # after a joint's name: the curve of its collision levels


class Question(msgspec.Struct, frozen=True, kw_only=True):
    """Question to every recording."""

    levels: dict[str, tuple[float, ...]] = {}  # of these joints, ascending [Nm]
    collisions: dict[str, tuple[float, ...]] = {}  # the same of collision levels
    residual: str = ""  # by name; empty: the one that decided
    changes: tuple[Change, ...] = ()
    fresh: bool = False  # the estimator begins anew, as after switching on
    until_reaction: bool = False  # what comes after it is left out


class Curve(msgspec.Struct, kw_only=True):
    """Counts at each level of one joint, or of the arm."""

    levels: list[float]  # [Nm]; of the arm the number of each step
    contacts: list[int]
    false: list[int]  # those that begin outside of every label
    beyond_s: list[float]  # time in which one lasts
    labels: int = 0
    found: list[int] = []  # labels with a contact in them
    delays_s: list[list[float]] = []  # of the found ones, for each level

    def __add__(self, other: "Curve") -> "Curve":
        """Both recordings together. Raises ValueError for other levels."""
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


class Found(msgspec.Struct, frozen=True):
    """One contact at the levels in force."""

    time_s: float
    joint: str
    torque: float  # residual when it began [Nm]
    threshold: float  # in force then [Nm]


class Answer(msgspec.Struct, kw_only=True):
    """Answer of one recording, or the reason why there is none."""

    file: str
    failed: str = ""
    broken: str = ""  # reason why the recording ends early, without its name: the rest counts
    duration_s: float = 0.0
    watched_s: float = 0.0  # in which contacts are reported, and counted here
    outside_s: float = 0.0  # of that, outside of every label
    skipped_s: float = 0.0  # left out of a replay, after states that were lost
    reaction_s: float | None = None
    shares_known: bool = True
    recorded: list[Found] = []  # contacts as recorded
    contacts: list[Found] = []  # the same with other settings, or by another residual
    recorded_N: float = 0.0  # largest force at the tool that was shown, as recorded
    force_N: float = 0.0  # the same with other settings
    curves: dict[str, Curve] = {}
