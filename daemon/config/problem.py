"""Problem of a configuration, and its place in the file."""

from dataclasses import dataclass

from daemon.config.schema import Joint

Keys = list[str | int]


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem: keys and printed path of the field, and what is wrong and allowed."""

    keys: Keys
    where: str
    what: str


def figure(value: float) -> str:
    """Number with four significant digits for display; rounding errors are shown as 0."""
    return f"{value:.4g}" if abs(value) >= 1e-9 else "0"


def agree(a: float, b: float, factor: float) -> bool:
    """True if two positive values differ by at most this factor."""
    return b / factor <= a <= b * factor


def at(index: int, joint: Joint, *path: str) -> tuple[Keys, str]:
    """Keys and printed path of a field of a joint."""
    return ["joints", index, *path], ".".join([f"joints[{index}] ({joint.name})", *path])
