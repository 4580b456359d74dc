"""Smallest detectable forces at the tool, over poses within the joint limits."""

import numpy as np

from common.arrays import Matrix
from daemon.assembly import build_estimator
from daemon.config.schema import Configuration
from daemon.config.vectors import limits_of
from estimator.model import Model
from estimator.tool_force import ToolSense, tool_sense

_POSES = 500


def poses_within(c: Configuration) -> Matrix:
    """Random poses (500, n) [rad] within the limits, always the same."""
    limits = limits_of(c)
    return np.random.default_rng(0).uniform(limits.lower, limits.upper, (_POSES, len(c.joints)))


def sensitivity_over_poses(c: Configuration, model: Model) -> list[str]:
    """Smallest detectable force of a hand at the tool, in words: in motion, every joint at its
    velocity limit, and at rest, before anything is learned about friction and gaps."""
    estimator, limits = build_estimator(c, model), limits_of(c)
    jacobians = [model.tool_jacobian(q) for q in poses_within(c)]
    # A new estimator has learned nothing yet, so its levels are the highest.
    cases = (
        ("in motion", estimator.levels_at(limits.velocity)),
        ("at rest", estimator.levels_at(np.zeros(len(c.joints)))),
    )
    return [
        f"smallest touch just after switching on, at {model.tool}, over {_POSES} poses "
        "within the limits:",
        *(_in_words(name, [tool_sense(J, level) for J in jacobians]) for name, level in cases),
    ]


def _in_words(name: str, senses: list[ToolSense]) -> str:
    best = [sense.least for sense in senses]
    parts = [f"{min(best):.1f} to {max(best):.1f} N at best"]
    # Along a line there is no worse direction.
    if worst := [sense.most for sense in senses if len(sense.undetected) < 2]:
        usual, rare = np.percentile(worst, (50, 95))
        parts.append(f"at worst {usual:.0f} N in half the poses, over {rare:.0f} N in one of 20")
    if deaf := sum(1 for sense in senses if len(sense.undetected)):
        parts.append(f"not detected in some direction in {deaf / len(senses):.0%} of the poses")
    return f"  {name:9}  {'; '.join(parts)}"
