"""Problem of a configuration, and its place in the file."""

from dataclasses import dataclass

from daemon.config.schema import Joint

Keys = list[str | int]


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong: its place in the file, and what is allowed."""

    keys: Keys
    where: str
    what: str


def figure(value: float) -> str:
    """A number of four digits for people; what is only rounding is 0."""
    return f"{value:.4g}" if abs(value) >= 1e-9 else "0"


def agree(a: float, b: float, factor: float) -> bool:
    """True where two positive figures differ by no more than a factor."""
    return b / factor <= a <= b * factor


def at(index: int, joint: Joint, *path: str) -> tuple[Keys, str]:
    """Keys and words for a place within a joint."""
    return ["joints", index, *path], ".".join([f"joints[{index}] ({joint.name})", *path])
