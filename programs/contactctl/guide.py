"""`contactctl guide`: the directions in which a hand leads the arm, shown and changed."""
# ruff: noqa: PLC0415 - messages are imported by what needs them

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
    """Axes in one word: `xy`, `x,rz`, `rx ry rz`. Raises BadParameter for others."""
    if not re.fullmatch(r"(r?[xyz][, ]*)*", value):
        raise click.BadParameter(f"{value!r} is not of x, y, z, rx, ry, rz", ctx, param)
    return tuple(cast("list[Axis]", re.findall(r"r?[xyz]", value)))


def _axes(name: str, text: str) -> Callable[[FC], FC]:
    return click.option(name, callback=axes_of, default="", metavar="AXES", help=text)


@click.command(cls=Command)
@click.argument("shape", required=False, type=click.Choice([*SHAPES, "off"]))
@click.argument("along", required=False, metavar="[AXES]")
@_axes("--stiff", "Held, and taken back to where the guide began.")
@_axes("--held", "Held, without a spring.")
@_axes("--damped", "Five times as slow.")
@click.option("--no-turn", is_flag=True, help="The same as --stiff rx,ry,rz.")
@click.option("--joints-held", is_flag=True, help="Joints that may move beside the tool stand.")
@click.option("--frame", metavar="F", help="Axes: `tool` (default), `base`, or a link of the URDF.")
@click.pass_obj
def guide(
    options: Options, shape: str | None, along: str | None, stiff: tuple["Axis", ...],
    held: tuple["Axis", ...], damped: tuple["Axis", ...], no_turn: bool, joints_held: bool,
    frame: str | None,
) -> None:  # fmt: skip
    """Show or change the guide of an arm that is led by hand.

    \b
    guide line x              the tool moves along its x alone, and may turn
    guide plane xy --no-turn  in a plane, always turned the same way
    guide point               about its point
    guide --damped z          slowly along z, else as before
    guide off                 as without one

    Also while the arm is led. It begins where it is led next, and anew there once the arm moved by
    itself. The configuration is not changed.
    """
    refuse_none_left(shape, along, (*stiff, *held))
    stiff = (*stiff, *shape_axes(shape, along), *(("rx", "ry", "rz") if no_turn else ()))
    with options.connect() as client:
        if not (shape or stiff or held or damped or joints_held):
            if frame:
                raise click.UsageError("--frame belongs to a guide")
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
    """Axes that a shape holds. Raises UsageError for one that is not along the axes given."""
    given = tuple(along or "")
    count = {"line": 1, "plane": 2}.get(shape or "", 0)
    if len(set(given)) != count or len(given) != count or not set(given) <= set(_XYZ):
        wanted = ["takes no axes", "runs along one of x, y, z", "has two of x, y, z"][count]
        named = "off" if shape == "off" else f"a {shape}"
        raise click.UsageError(f"{named} {wanted}, not {along or 'none'}")
    return tuple(axis for axis in _XYZ if axis not in given) if shape in SHAPES else ()


def refuse_none_left(shape: str | None, along: str | None, kept: tuple["Axis", ...]) -> None:
    """Raises UsageError for an axis that a line or plane runs along and that is held."""
    if both := sorted({*(along or "")} & {*kept}):
        raise click.UsageError(f"the {shape} runs along {', '.join(both)}, which cannot be held")
