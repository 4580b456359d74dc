"""Problem of a configuration, and its place in the file."""

from dataclasses import dataclass

from daemon.config.schema import Joint

Keys = list[str | int]


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem: its place in the file, and the allowed values."""

    keys: Keys
    where: str
    what: str


def figure(value: float) -> str:
    """Number with four digits for display; rounding errors show as 0."""
    return f"{value:.4g}" if abs(value) >= 1e-9 else "0"


def agree(a: float, b: float, factor: float) -> bool:
    """True if two positive values differ by no more than a factor."""
    return b / factor <= a <= b * factor


def at(index: int, joint: Joint, *path: str) -> tuple[Keys, str]:
    """Keys and printed path of a place within a joint."""
    return ["joints", index, *path], ".".join([f"joints[{index}] ({joint.name})", *path])
