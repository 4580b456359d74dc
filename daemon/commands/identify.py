"""`contactd identify`: the command lines of its steps."""
# ruff: noqa: PLC0415 - each command imports what it needs, so that `--help` starts at once

import sys
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from daemon.commands.options import PATH, SOCKET, Range


class _InOrder(click.Group):
    """Group that lists its commands in the order in which a person needs them."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)


@click.group(cls=_InOrder, invoke_without_command=True)
@click.option("--config", type=PATH,
              help="Robot's folder; by default that of the running daemon.")  # fmt: skip
@SOCKET
@click.pass_context
def identify(context: click.Context, config: Path | None, socket: Path | None) -> None:
    """Find out what an arm's parameters are, step by step, on the arm or on recorded logs.

    Without a step: what is known of each joint, how good and how old it is, and the next command;
    nothing moves. The options here belong to that; each step has its own.

    Without --log a running daemon moves the arm, and the person beside it has read
    docs/commissioning.md. Drives that are off are enabled for the step, which asks before, and are
    off again after it; the daemon then takes up what was found. After a fault it asks whether to
    reset that, too. Every step can be stopped by Ctrl-C
    at any time: the arm holds, and the same command goes on from there. Results go to
    identified.yaml beside the configuration.
    """
    if context.invoked_subcommand is None:
        from daemon.commands.identification import show_overview

        sys.exit(0 if show_overview(config, socket) else 1)
    given = {context.get_parameter_source(option) for option in ("config", "socket")}
    if ParameterSource.COMMANDLINE in given:
        raise click.UsageError("--config and --socket go behind the step")


def _identification(step: Any) -> Any:
    """Options that all steps share."""
    options = [
        click.option("--config", type=PATH,
                     help="Robot's folder; by default that of the running daemon."),
        click.option("--log", "logs", type=PATH, multiple=True,
                     metavar="FILE",
                     help="Learn from a recording (.mcap, may be repeated) or a log of another "
                     "program (docs/logs.md), instead of moving the arm."),
        click.option("--dry-run", is_flag=True, help="Write no results and no pictures."),
        click.option("--yes", is_flag=True,
                     help="Reset a fault, and enable drives that are off, without a question, "
                     "for scripts."),
        SOCKET,
    ]  # fmt: skip
    for option in reversed(options):
        step = option(step)
    return step


def _begin(
    config: Path | None, logs: tuple[Path, ...], dry_run: bool, yes: bool, socket: Path | None
) -> Any:
    from daemon.commands.identification import identification

    return identification(config, logs, socket, dry=dry_run, yes=yes)


@identify.command()
@click.argument("angles", nargs=-1, required=True, metavar="JOINT=ANGLE...")
@click.option("--config", type=PATH, help="Robot's folder; by default that of the running daemon.")
@click.option("--dry-run", is_flag=True, help="Write no results.")
@SOCKET
def zero(angles: tuple[str, ...], config: Path | None, dry_run: bool, socket: Path | None) -> None:
    """Push links while the drives are off: signs and zeros of their encoders.

    ANGLE is where the link stands by the URDF [rad]. You push each a little, either way, and say
    which way it went while you hold it. What is found counts in the place of `link_sign` and
    `link_offset`.
    """
    from daemon.commands.go import destination

    pose, stated = destination(angles)
    if pose:
        raise click.UsageError(f"{pose!r}: JOINT=ANGLE for each joint whose encoder is to be set")
    with _begin(config, (), dry_run, False, socket) as identification:
        sys.exit(0 if identification.zero(stated) else 1)


@identify.command()
@click.argument("joints", nargs=-1, metavar="[JOINT]...")
@_identification
def wiring(joints: tuple[str, ...], **asked: Any) -> None:
    """Move joint by joint a little: do signs and scales agree?"""
    with _begin(**asked) as identification:
        sys.exit(0 if identification.wiring(joints) else 1)


@identify.command()
@click.argument("joints", nargs=-1, metavar="[JOINT]...")
@click.option("--by-hand", is_flag=True,
              help="Hold the motor still while you move the link.")  # fmt: skip
@_identification
def gap(joints: tuple[str, ...], by_hand: bool, **asked: Any) -> None:
    """Turn the motors to and fro, joint by joint: how large are the gaps?

    Where a link stays at one border of its gap in every pose, it takes a hand: --by-hand.
    """
    with _begin(**asked) as identification:
        sys.exit(0 if identification.gap(joints, by_hand=by_hand) else 1)


@identify.command()
@click.option("--seconds", default=60.0, show_default=True, type=Range(20, 600))
@click.option("--shortest", default=20.0, show_default=True, type=Range(5, 600),
              help="Motion that a log must have [s]; less than 20 at your own risk.")  # fmt: skip
@_identification
def masses(seconds: float, shortest: float, **asked: Any) -> None:
    """Move all joints, without contact and with an empty hand: masses and centres of the links.

    Needed where the URDF's are wrong: `friction` says so. They count in the place of the URDF's,
    which stays as it is; friction and thresholds are identified after them.
    """
    with _begin(**asked) as identification:
        sys.exit(0 if identification.masses(seconds, shortest) else 1)


@identify.command()
@click.argument("name")
@click.option("--seconds", default=10.0, show_default=True, type=Range(8, 120))
@_identification
def payload(name: str, seconds: float, **asked: Any) -> None:
    """Move all joints with a load in the hand: its mass and centre, for `contactctl payload NAME`.

    A load so heavy that it is taken for a collision is told roughly before: `contactctl payload`.
    """
    with _begin(**asked) as identification:
        sys.exit(0 if identification.payload(name, seconds) else 1)


@identify.command()
@click.option("--seconds", default=60.0, show_default=True, type=Range(20, 600))
@click.option("--shortest", default=10.0, show_default=True, type=Range(5, 600),
              help="Motion that a log must have [s]; less than 10 at your own risk.")  # fmt: skip
@_identification
def friction(seconds: float, shortest: float, **asked: Any) -> None:
    """Move all joints, without contact: friction and rotor inertia."""
    with _begin(**asked) as identification:
        sys.exit(0 if identification.friction(seconds, shortest) else 1)


@identify.command()
@click.argument("joints", nargs=-1, metavar="[JOINT]...")
@click.option("--seconds", default=120.0, show_default=True, type=Range(20, 600))
@_identification
def encoders(joints: tuple[str, ...], seconds: float, **asked: Any) -> None:
    """Move all joints slowly through their ranges: what do link encoders err with each turn?

    Arming does without. What is found is taken off the samples once it is taken up. It takes
    position encoders at the motors.
    """
    with _begin(**asked) as identification:
        sys.exit(0 if identification.encoders(joints, seconds) else 1)


@identify.command()
@click.option("--seconds", default=120.0, show_default=True, type=Range(40, 7200))
@click.option("--per-hour", default=1.0, show_default=True, type=Range(1e-3, 1000),
              help="False contacts per joint and hour that are bearable.")  # fmt: skip
@click.option("--it-was-me", is_flag=True,
              help="Every stretch that looks like a touch, and is left out, was you.")  # fmt: skip
@_identification
def thresholds(seconds: float, per_hour: float, it_was_me: bool, **asked: Any) -> None:
    """Move all joints, without contact: levels from the residuals."""
    with _begin(**asked) as identification:
        good = identification.thresholds(seconds, per_hour, it_was_me=it_was_me)
        sys.exit(0 if good else 1)
