"""Parser of a motion's destination: a pose, or JOINT=VALUE for each joint."""

import math
from collections.abc import Sequence

import click


def destination(words: Sequence[str]) -> tuple[str, dict[str, float]]:
    """Pose, or targets [rad] by joint, from the words of a command line. Raises UsageError."""
    if len(words) == 1 and words[0] and "=" not in words[0]:
        return words[0], {}
    targets: dict[str, float] = {}
    for word in words:
        joint, equals, text = word.partition("=")
        if not (joint and equals):
            raise click.UsageError(f"{word!r}: give either one POSE or JOINT=VALUE for each joint")
        if joint in targets:
            raise click.UsageError(f"{joint} is given twice")
        try:
            targets[joint] = float(text)
        except ValueError:
            targets[joint] = math.nan
        if not math.isfinite(targets[joint]):
            raise click.UsageError(f"{word!r}: {text!r} is not a position in rad")
    return "", targets
