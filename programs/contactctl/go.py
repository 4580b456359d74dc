"""`contactctl go` and `home`: show the planned path, ask, and run the motion to its end.

Ctrl-C or closing the terminal stops the arm; if this program is killed or hangs, the daemon does.
"""
# ruff: noqa: PLC0415 - the client is imported by the command that needs it

import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from daemon.modes.table import Mode
from daemon.protocol.bounds import FASTEST, SLOWEST
from programs.command_line.destination import destination
from programs.command_line.options import Command, Options, Range
from programs.command_line.questions import confirmed
from programs.command_line.sentences import say
from programs.contactctl.replies import (
    NOT_REACHED_ON_ITS_WAY,
    POLL_S,
    RESTING,
    answer,
    carry_out,
    lost_as,
    print_json,
)

if TYPE_CHECKING:
    from daemon.protocol.replies import PlannedPath, Reply
    from programs.clients.client import Client

# Tolerance within which a joint counts as arrived: what friction may leave, and no more [rad].
THERE_RAD = 0.02
VISIBLE_RAD = 5e-4  # shorter distances are not shown
NO_COLLISION_CHECK = (
    "There is no collision check: the arm takes this path through its own body, the table and you."
)
SHAPES_CHECKED = (
    "Checked against shapes.yaml and surroundings.yaml alone: the arm does not know where you are."
)


_speed = click.option(
    "--speed",
    type=Range(min=SLOWEST, max=FASTEST),
    default=0.2,
    show_default=True,
    metavar="RAD/S",
    help="Speed of the joint that goes furthest; others are slower, so that all arrive together.",
)
_yes = click.option("--yes", is_flag=True, help="Do not ask, for scripts.")


@click.command(cls=Command)
@click.argument("words", nargs=-1, metavar="[POSE | JOINT=VALUE ...]")
@_speed
@_yes
@click.pass_obj
def go(options: Options, words: tuple[str, ...], speed: float, yes: bool) -> None:
    """Move to a pose of the configuration, or joints to positions in rad: the arm moves.

    Shows distance and time per joint, and asks first. The path is a straight line in joint space
    within all limits, checked for collisions only if the arm has shapes. A contact halts an arm
    that is not armed; an armed arm reacts as on any trajectory, then continues. After a halt, give
    the command again. Ctrl-C stops. Needs an identified arm. Without an argument: lists the poses.
    """
    move(options, words, speed, yes=yes)


@click.command(cls=Command)
@_speed
@_yes
@click.pass_obj
def home(options: Options, speed: float, yes: bool) -> None:
    """Move to the pose `home` of the configuration: `go home`."""
    move(options, ["home"], speed, yes=yes)


def move(options: Options, words: Sequence[str], speed: float, *, yes: bool) -> None:
    """Show the path, ask unless `yes`, move, and wait for the end; exits with 1 if the motion was
    refused or ended elsewhere. Without words: list the poses."""
    if not words:
        if yes:  # probably a script with an empty variable: nothing moves, which must not succeed
            raise click.UsageError("--yes moves the arm: to which POSE, or JOINT=VALUE?")
        _list_poses(options)
        return
    pose, targets = destination(words)
    with options.connect() as client:
        reply = client.go(pose, targets, speed=speed, plan=True)
        if reply.way is None:
            answer(options, reply)
            return
        if not yes and (options.json or not sys.stdin.isatty()):
            raise click.UsageError(
                "cannot ask for confirmation with --json, or without a terminal; --yes skips it"
            )
        if not options.json:
            say(in_words(reply.way))
            for warning in reply.warnings:
                say(f"  warning: {warning}", err=True)
    if not yes and not confirmed("Move the arm?"):
        raise click.Abort
    with _interrupted() as interrupted, options.connect() as client:
        start = reply.way.start
        with lost_as(NOT_REACHED_ON_ITS_WAY):
            reply = client.go(pose, targets, speed=speed, planned_from=start, attended=True)
            ended = None if reply.way is None else _wait(client, reply.way, interrupted)
        if reply.way is None:
            answer(options, reply)
            return
        if ended is None:  # stop before the connection closes: its end would only halt the arm
            carry_out(options, "stop", wait=True)
            sys.exit(1)
    answer(options, ended)


def in_words(path: "PlannedPath") -> str:
    """Table of the path, a line for each joint that moves, and which collisions are checked."""
    lines = [f"{'':16} {'from':>8} {'to':>8} {'distance':>9} {'speed':>9} {'time':>7}"]
    joints = zip(path.joints, path.start, path.goal, path.speed, strict=True)
    for name, start, goal, speed in joints:
        if abs(goal - start) >= VISIBLE_RAD:
            figures = f"{start:8.3f} {goal:8.3f} {goal - start:+9.3f} {speed:9.3f}"
            lines.append(f"{name:16} {figures} {path.duration_s:5.1f} s")
    if len(lines) == 1:
        return f"{path.name}: the arm is there already"
    lines.append("rad and rad/s; all joints start and arrive together, other joints do not move.")
    return "\n".join([*lines, SHAPES_CHECKED if path.shapes else NO_COLLISION_CHECK])


def _wait(client: "Client", path: "PlannedPath", interrupted: Callable[[], bool]) -> "Reply | None":
    """Reply on where the motion ended, once the mode is one of RESTING; None when interrupted.
    Keeps waiting while a person guides the arm."""
    from daemon.protocol.replies import Reply

    while not interrupted():
        now = client.ask_status()
        if now.mode in RESTING:
            places = zip(path.joints, now.link_position, path.goal, strict=True)
            far = [
                f"{name} is at {q:.3f} rad, {abs(q - goal):.3f} rad from {goal:.3f}"
                for name, q, goal in places
                if abs(q - goal) > THERE_RAD
            ]
            done = now.mode is Mode.HOLDING and now.trajectory.state == "ready" and not far
            text = f"{now.mode}: {now.cause}" if done else f"not arrived: {now.mode}, {now.cause}"
            reasons = [] if done else now.advice.splitlines() or far
            return Reply(ok=done, message=text, reasons=reasons, mode=now.mode, way=path)
        time.sleep(POLL_S)
    return None


@contextmanager
def _interrupted() -> Iterator[Callable[[], bool]]:
    """Predicate that is true once a signal asked this program to end, so that it first stops."""
    signals: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {n: signal.signal(n, lambda received, _: signals.append(received)) for n in numbers}
    try:
        yield lambda: bool(signals)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _list_poses(options: Options) -> None:
    with options.connect() as client:
        poses = client.ask_status().poses
    if options.json:
        print_json(poses)
        return
    for name, values in poses.items():
        places = " ".join(f"{joint}={value:g}" for joint, value in values.items())
        say(f"{name:16} {places}")
    if not poses:
        say("no `poses` in config.yaml as last read; `contactctl go JOINT=VALUE ...` needs none")
