"""`contactctl guide`: shows and changes the directions in which a hand can lead the arm."""
# ruff: noqa: PLC0415 - messages are imported by the function that needs them

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, cast

import click
from click.decorators import FC

from programs.command_line.options import Command, Options
from programs.command_line.sentences import say
from programs.contactctl.replies import answer, print_json

if TYPE_CHECKING:
    from daemon.protocol.guide import Axis

_XYZ: tuple["Axis", ...] = ("x", "y", "z")
SHAPES = ("line", "plane", "point")


def axes_of(
    ctx: click.Context | None, param: click.Parameter | None, value: str
) -> tuple["Axis", ...]:
    """Axes parsed from a word: `xy`, `x,rz`, `rx ry rz`. Raises BadParameter."""
    if not re.fullmatch(r"(r?[xyz][, ]*)*", value):
        raise click.BadParameter(f"{value!r} is not made of x, y, z, rx, ry, rz", ctx, param)
    return tuple(cast("list[Axis]", re.findall(r"r?[xyz]", value)))


def _axes(name: str, text: str) -> Callable[[FC], FC]:
    return click.option(name, callback=axes_of, default="", metavar="AXES", help=text)


@click.command(cls=Command)
@click.argument("shape", required=False, type=click.Choice([*SHAPES, "off"]))
@click.argument("along", required=False, metavar="[AXES]")
@_axes("--stiff", "Axes held, with a spring to where the guide began.")
@_axes("--held", "Axes held, without a spring.")
@_axes("--damped", "Axes along which the arm moves five times as slowly.")
@click.option("--no-turn", is_flag=True, help="The same as --stiff rx,ry,rz.")
@click.option("--joints-held", is_flag=True, help="Hold joints that could move without the tool.")
@click.option("--frame", metavar="F", help="Frame: `tool` (default), `base`, or a URDF link.")
@click.pass_obj
def guide(
    options: Options, shape: str | None, along: str | None, stiff: tuple["Axis", ...],
    held: tuple["Axis", ...], damped: tuple["Axis", ...], no_turn: bool, joints_held: bool,
    frame: str | None,
) -> None:  # fmt: skip
    """Show or change the guide: a constraint on an arm that is led by hand.

    \b
    guide line x              the tool moves only along its x axis, and may turn
    guide plane xy --no-turn  in a plane, with constant orientation
    guide point               turns about the tool point
    guide --damped z          slowly along z, freely otherwise
    guide off                 no constraint

    It can be changed while the arm is led. A guide begins where the arm is next led, and begins
    anew after the arm has moved by itself. The configuration is not changed.
    """
    refuse_none_left(shape, along, (*stiff, *held))
    stiff = (*stiff, *shape_axes(shape, along), *(("rx", "ry", "rz") if no_turn else ()))
    with options.connect() as client:
        if not (shape or stiff or held or damped or joints_held):
            if frame:
                raise click.UsageError("--frame requires a guide")
            axes = client.ask_status().guide
            print_json(axes) if options.json else say(f"guide: {axes}")
            return
        from daemon.protocol.guide import GuideAxes
        from daemon.protocol.requests import SetGuide

        if shape == "off" and (stiff or held or damped or joints_held or frame):
            raise click.UsageError("off takes no options")
        axes = GuideAxes(
            frame=frame or "tool",
            stiff=stiff,
            held=held,
            damped=damped,
            redundant="held" if joints_held else "free",
        )
        answer(options, client.ask(SetGuide(axes=axes)))


def shape_axes(shape: str | None, along: str | None) -> tuple["Axis", ...]:
    """Axes that a shape holds. Raises UsageError if the axes given do not fit the shape."""
    given = tuple(along or "")
    count = {"line": 1, "plane": 2}.get(shape or "", 0)
    if len(set(given)) != count or len(given) != count or not set(given) <= set(_XYZ):
        wanted = ["takes no axes", "runs along one of x, y, z", "has two of x, y, z"][count]
        named = "off" if shape == "off" else f"a {shape}"
        raise click.UsageError(f"{named} {wanted}, not {along or 'none'}")
    return tuple(axis for axis in _XYZ if axis not in given) if shape in SHAPES else ()


def refuse_none_left(shape: str | None, along: str | None, kept: tuple["Axis", ...]) -> None:
    """Raise UsageError for an axis that a line or plane runs along and that is held."""
    if both := sorted({*(along or "")} & {*kept}):
        raise click.UsageError(f"the {shape} runs along {', '.join(both)}, which cannot be held")
