"""`contactctl hand`: live control of the simulated hand, through the simulator's own socket."""

import json
import math
import re
import socket
from pathlib import Path
from typing import Any

import click

from common.errors import ControlError, UnreachableError
from daemon.protocol.socket_path import default_hand_path
from programs.command_line.options import PATH, OrderedGroup, Range, Signed

TIMEOUT_S = 5.0
AXES = ("x", "y", "z")


class Measure(click.ParamType):  # type: ignore[type-arg]
    """Number with an optional unit: `3Nm`, `0.5 rad`, `-2`."""

    def __init__(self, unit: str, low: float = -math.inf, high: float = math.inf) -> None:
        self.name = self._unit = unit
        self._low, self._high = low, high

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Number without its unit. Raises BadParameter for another unit, or beyond the bounds."""
        found = re.fullmatch(rf"([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?) ?(?:{self._unit})?", str(value))
        if found is None:
            self.fail(f"{value!r} is no value in {self._unit}, such as 3{self._unit}.", param, ctx)
        if not self._low <= float(found[1]) <= self._high:
            allowed = f"{self._low:g} to {self._high:g} {self._unit}"
            self.fail(f"{value!r} is out of range: {allowed}.", param, ctx)
        return float(found[1])


def ask_hand(path: Path, act: dict[str, Any]) -> str:
    """Send an action to the simulated hand, and return its answer. Raises UnreachableError if no
    simulator listens, ControlError if it refuses."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.settimeout(TIMEOUT_S)
        try:
            connection.connect(str(path))
            connection.sendall(json.dumps({"at_s": 0.0, **act}).encode() + b"\n")
            with connection.makefile() as answers:
                answer = json.loads(answers.readline())
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            raise UnreachableError(
                f"no simulated hand answers at {path}: {why}; is `contactd simulate` running, with "
                f"that --hand-socket? Without it both use {default_hand_path()}; a real arm has no "
                "simulated hand"
            ) from error
    if not answer["ok"]:
        raise ControlError(answer["text"])
    return str(answer["text"])


def _take_path(ctx: click.Context, _: click.Parameter, given: Path | None) -> None:
    ctx.obj = given or ctx.obj


def socket_path_option() -> click.Option:
    """Option --hand-socket, allowed before or after a command."""
    return click.Option(
        ["--hand-socket", "path"],
        type=PATH,
        metavar="PATH",
        help="The simulator's socket, instead of the default.",
        callback=_take_path,
        expose_value=False,
    )


class HandCommand(Signed):
    """Command of the hand, with --hand-socket."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self.params.append(socket_path_option())


class HandCommands(OrderedGroup):
    """Group of the hand's commands."""

    command_class = HandCommand


@click.group(cls=HandCommands, params=[socket_path_option()])
@click.pass_context
def hand(context: click.Context) -> None:
    """Touch a simulated arm, live: control the hand in `contactd simulate`.

    The daemon is not informed of it and has to detect it.
    """
    if not isinstance(context.obj, Path):  # replaces the Options of the parent group
        context.obj = default_hand_path()


_SIGNED = {"ignore_unknown_options": True}  # so that -3Nm is a torque
_JOINT = click.argument("joint")
_TORQUE = click.argument("torque", type=Measure("Nm", -500.0, 500.0))
_LARGEST = Measure("Nm", 0.001, 500.0)


def _do(path: Path, **act: Any) -> None:
    click.echo(ask_hand(path, act))


@hand.command(context_settings=_SIGNED)
@_JOINT
@_TORQUE
@click.option("--seconds", type=Range(min=0.01, max=600), default=0.5, show_default=True)
@click.pass_obj
def push(path: Path, joint: str, torque: float, seconds: float) -> None:
    """Push JOINT with TORQUE for some time."""
    _do(path, act="push", joint=joint, torque=torque, duration_s=seconds, shape="pulse")


@hand.command(context_settings=_SIGNED)
@_JOINT
@_TORQUE
@click.pass_obj
def lean(path: Path, joint: str, torque: float) -> None:
    """Lean on JOINT with TORQUE, until `release`."""
    _do(path, act="lean", joint=joint, torque=torque)


@hand.command(context_settings=_SIGNED)
@click.argument("axis", type=click.Choice(AXES))
@click.argument("force", type=Measure("N", -500.0, 500.0))
@click.option("--seconds", type=Range(min=0.01, max=600), help="Without it until `release`.")
@click.pass_obj
def press(path: Path, axis: str, force: float, seconds: float | None) -> None:
    """Press the tool with FORCE along AXIS (x, y or z) of the URDF's last link."""
    _do(path, act="press", force=[force * (one == axis) for one in AXES], duration_s=seconds)


@hand.command(context_settings=_SIGNED)
@_JOINT
@click.argument("position", type=Measure("rad", -100.0, 100.0))
@click.option("--speed", type=Range(min=0.01, max=5), default=0.3, show_default=True,
              help="rad/s.")  # fmt: skip
@click.option(
    "--torque",
    type=_LARGEST,
    help="Largest torque; by default a fifth of the motor's, and no more than 4 Nm.",
)
@click.pass_obj
def lead(path: Path, joint: str, position: float, speed: float, torque: float | None) -> None:
    """Grip JOINT, lead it to POSITION, and hold it there until `release`."""
    _do(path, act="guide", to={joint: position}, speed=speed, max_torque=torque)


@hand.command()
@_JOINT
@click.option(
    "--torque", type=_LARGEST, help="Largest torque; by default a hundredth of the motor's."
)
@click.option("--times", type=click.IntRange(1, 1000), default=40, show_default=True)
@click.pass_obj
def gap(path: Path, joint: str, torque: float | None, times: int) -> None:
    """Move JOINT's link between the edges of its gap, for `contactd identify gap --by-hand`."""
    _do(path, act="gap", joint=joint, torque=torque, times=times)


@hand.command()
@click.argument("joints", nargs=-1, required=True, metavar="JOINT...")
@click.pass_obj
def clamp(path: Path, joints: tuple[str, ...]) -> None:
    """Clamp joints where they are by something hard, until `release`."""
    _do(path, act="clamp", joints=list(joints))


@hand.command(context_settings=_SIGNED)
@click.argument("mass", type=Measure("kg", 0.0, 100.0))
@click.option(
    "--com",
    nargs=3,
    type=float,
    metavar="X Y Z",
    help="Its centre of mass in the frame of the URDF's last link [m].  [default: the tool point]",
)
@click.pass_obj
def carry(path: Path, mass: float, com: tuple[float, float, float] | None) -> None:
    """Put MASS into the arm's hand; 0 takes it away."""
    _do(path, act="give", mass=mass, com=com)


@hand.command()
@click.pass_obj
def release(path: Path) -> None:
    """Let go of the arm; what it carries stays."""
    _do(path, act="release")
