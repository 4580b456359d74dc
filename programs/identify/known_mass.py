"""`contactd identify wrench`: compares the estimated force at the tool with a known one."""
# ruff: noqa: PLC0415 - the command imports what it needs when it runs

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from common.errors import LogError
from programs.command_line.options import PATH, Range
from programs.command_line.sentences import say

if TYPE_CHECKING:
    from common.arrays import Vector
    from daemon.protocol.state import Snapshot, State
    from identification.known_force import HeldPose

FREE_S, HELD_S, STILL_RAD, LEAST_POSES, APART_RAD = 2.0, 2.0, 0.02, 3, 0.3
"""Unloaded start and loaded end of a recording; largest motion between them; least number of poses,
of which the last is held out; least difference of two poses, in any joint."""
_G: Final = 9.80665
_FRICTION: Final = 0.4  # share of a level's increase at rest that holds a load, in 95 % of cases


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=PATH, metavar="FILE.mcap...")
@click.option("--mass", type=Range(min=0.05, max=50), help="Mass hung from the tool point [kg].")
@click.option(
    "--scale", type=Range(min=0.5, max=500), help="Or reading of a scale under the tool [N]."
)
def wrench(recordings: tuple[Path, ...], mass: float | None, scale: float | None) -> None:
    """Compare the estimated force at the tool with a known one, and report its error.

    Needs one recording of 10 s per pose, with the arm holding: 2 s without the mass, then hang it
    from the tool point and keep your hands off. From three or more poses that differ by 0.3 rad it
    proposes corrections of torque constants, which the last pose has to confirm. Writes nothing.
    """
    if (mass is None) == (scale is None):
        raise click.UsageError("give either --mass or --scale")
    up = -mass * _G if mass is not None else float(scale or 0.0)
    for line in report(recordings, up):
        say(line)


def report(recordings: Sequence[Path], up: float) -> list[str]:
    """Report as lines of text; up: the known force, upwards [N]. Raises LogError."""
    import numpy as np

    from identification.known_force import MOST, correct

    lines, poses = [f"{'pose':20}  error of the force, by axis of its frame"], list["HeldPose"]()
    joints, at = list[str](), list["Vector"]()
    for path in recordings:
        snapshot, pose, off, unseen, seen, q = _held(path, up)
        parts = " ".join(f"{axis} {x:+.1f}" for axis, x in zip("xyz", off, strict=True))
        blind = f", of which {seen:.1f} are observable; {unseen} not" if unseen else ""
        lines.append(f"{path.name:20}  {parts} N, of {abs(up):.1f}{blind}")
        poses.append(pose)
        joints = snapshot.joints
        at.append(q)
    if len(poses) < LEAST_POSES:
        return [*lines, f"torque constants need {LEAST_POSES} poses, the last for validation"]
    if min(np.abs(a - b).max() for a, b in combinations(at, 2)) < APART_RAD:
        return [*lines, f"torque constants need poses that differ pairwise by {APART_RAD} rad"]
    found = correct(poses)
    for name, factor, bound, proposed, beyond in zip(
        joints, found.factor, found.bound, found.proposed, found.beyond, strict=True
    ):
        if not np.isfinite(bound):
            lines.append(f"{name:20}  not observable beyond its friction")
            continue
        advice = f": `torque_constant` times {proposed:.3f}" if proposed != 1.0 else ": unchanged"
        advice = f": wrong by more than {MOST:.0%}" if beyond else advice
        lines.append(f"{name:20}  {factor:.3f} +- {bound:.3f} times its torque{advice}")
    verdict = "confirms" if found.witnessed else "does not confirm: change nothing"
    error = f"error {found.before_N:.1f} N, {found.after_N:.1f} N with the corrections"
    if found.beyond.any():
        return [
            *lines,
            "change nothing: was it this mass, hung from the tool point after two seconds?",
        ]
    if np.all(found.proposed == 1.0):
        return [*lines, "no torque constant is wrong by more than its friction hides"]
    return [*lines, f"the held-out pose, {recordings[-1].name}, {verdict}: {error}"]


def _held(path: Path, up: float) -> "tuple[Snapshot, HeldPose, Vector, str, float, Vector]":
    """Snapshot and held pose of a recording, error of the estimated force (3,) [N], directions that
    are unobservable, in words, norm of the observable force [N], and q (n,). Raises LogError."""
    import numpy as np

    from daemon.protocol.state import Snapshot
    from estimator.model import Model
    from identification.known_force import HeldPose
    from programs.clients.log_reader import read_log
    from programs.clients.sensitivity import along

    snapshot, states = None, list["State"]()
    for message in read_log(path):
        if isinstance(message, Snapshot):
            snapshot = message
        elif message.wrench is not None and message.level_share is not None:
            states.append(message)
    if snapshot is None or not states or states[-1].time_s - states[0].time_s < FREE_S + HELD_S:
        raise LogError(
            f"{path}: at least {FREE_S + HELD_S:g} s with a force at the tool are needed"
        )
    free = [s for s in states if s.time_s < states[0].time_s + FREE_S]
    held = [s for s in states if s.time_s > states[-1].time_s - HELD_S]
    q0, q, r0, r, level, share = (
        np.median([getattr(s, name) for s in part], axis=0)
        for part, name in (
            (free, "link_position"), (held, "link_position"), (free, "residual"),
            (held, "residual"), (held, "threshold"), (held, "level_share"),
        )
    )  # fmt: skip
    if np.abs(q - q0).max() > STILL_RAD:
        raise LogError(f"{path}: the arm moved by {np.abs(q - q0).max():.2f} rad; it has to hold")
    model = Model(snapshot.urdf, snapshot.joints)
    force = -up * model.down / np.linalg.norm(model.down)
    friction = np.maximum(level - share * np.array(snapshot.thresholds), 0.05 * level)
    pose = HeldPose(force, r - r0, _FRICTION * friction, model.tool_jacobian(q))
    said = [s.wrench for s in held if s.wrench is not None]
    unseen = [w.unseen for w in said][len(said) // 2]
    axes = model.axes(q, "" if snapshot.wrench_axes == model.hand else snapshot.wrench_axes)
    truth = axes.T @ force
    for way in np.array(unseen).reshape(-1, 3):
        truth = truth - way * (way @ truth)
    off = np.median([w.force for w in said], axis=0) - truth
    blind = " and ".join(f"along {along(way)}" for way in unseen)
    return snapshot, pose, off, blind, float(np.linalg.norm(truth)), q
