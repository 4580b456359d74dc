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


def at(index: int, joint: Joint, *path: str) -> tuple[Keys, str]:
    """Keys and words for a place within a joint."""
    return ["joints", index, *path], ".".join([f"joints[{index}] ({joint.name})", *path])
