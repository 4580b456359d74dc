"""Options that all commands of `contactctl` accept, before or after the command; parameter types of
paths and numbers for all command lines."""
# ruff: noqa: PLC0415 - the client is imported by the command that needs it

import itertools
import math
import os
import re
import sys
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from common.errors import ContactdError, LogError
from programs.command_line.sentences import read_to_the_end, say, write_failure

if TYPE_CHECKING:
    from programs.clients.client import Client


class _Path(click.Path):
    """Path that must not be empty, as from an unset variable in a script: it would mean `.`."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert a value. Raises UsageError for an empty one."""
        if os.fspath(value) == "":
            raise click.UsageError(f"{_named(param)} is empty", ctx)
        return super().convert(value, param, ctx)


def _named(param: click.Parameter | None) -> str:
    """Name of an option or argument, as shown by --help."""
    if isinstance(param, click.Argument):
        return (param.metavar or param.human_readable_name).strip("[]").rstrip(".")
    return param.opts[-1] if param is not None else "the path"


# `readable=False` disables click's own check, whose message and exit status differ from ours. The
# code that opens the file reports errors.
PATH: Final = _Path(path_type=Path, readable=False)
SOCKET: Final = click.option(
    "--socket", type=PATH, metavar="PATH", help="Control socket, instead of the default."
)
"""Option --socket of commands of `contactd`, given after their name."""


@dataclass(frozen=True, slots=True)
class Options:
    """Options given before the command."""

    socket: Path | None
    json: bool

    def connect(self) -> "Client":
        """New connection to the daemon. Raises UnreachableError."""
        from programs.clients.client import Client

        return Client(self.socket)


def _take_json(ctx: click.Context, _: click.Parameter, given: bool) -> None:
    if given:
        ctx.obj = replace(ctx.obj, json=True)


def _take_socket(ctx: click.Context, _: click.Parameter, given: Path | None) -> None:
    if given is not None:
        ctx.obj = replace(ctx.obj, socket=given)


class Signed(click.Command):
    """Command that accepts negative numbers as arguments (`ignore_unknown_options`), but still
    reports unknown options."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments. Raises NoSuchOption, or UsageError for an option of the group."""
        known = {name for param in self.get_params(ctx) for name in param.opts}
        group = ctx.parent.command.params if ctx.parent else []
        for word in itertools.takewhile(lambda word: word != "--", args):
            name = word.partition("=")[0]
            if re.match("-[-a-zA-Z]", name) and name not in known:
                if any(name in param.opts for param in group):
                    raise click.UsageError(f"{name} must precede `{ctx.info_name}`", ctx)
                near = get_close_matches(name, known)
                raise click.NoSuchOption(name, possibilities=near, ctx=ctx)
        return super().parse_args(ctx, args)


class Command(Signed):
    """Command that also accepts the common options, so that they may stand before or after it."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self.params += [socket_option(_take_socket), json_option(_take_json)]


def socket_option(callback: Any = None) -> click.Option:
    """Option --socket."""
    return click.Option(
        ["--socket"],
        type=PATH,
        metavar="PATH",
        help="The daemon's control socket; by default $CONTACTD_SOCKET, else that of the service, "
        "/run/contactd/control, else that of your own daemon: $XDG_RUNTIME_DIR/contactd.sock or "
        "/tmp/contactd-UID.sock.",
        callback=callback,
        expose_value=callback is None,
    )


def json_option(callback: Any = None) -> click.Option:
    """Option --json."""
    return click.Option(
        ["--json", "as_json"],
        is_flag=True,
        help="Answer in one line of JSON, for programs.",
        callback=callback,
        expose_value=callback is None,
    )


class Listing(click.Group):
    """Group whose --help shows the whole first sentence of each command, which click would cut, and
    that lists its commands if one is unknown."""

    others = ""
    """End of the message that lists the commands, on commands of another program."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands."""
        commands = ((name, self.get_command(ctx, name)) for name in self.list_commands(ctx))
        with formatter.section("Commands"):
            formatter.write_dl([(name, c.get_short_help_str(999)) for name, c in commands if c])

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """Resolve the first argument as a command. Raises UsageError that lists all commands."""
        if args and not args[0].startswith("-") and self.get_command(ctx, args[0]) is None:
            known = ", ".join(self.list_commands(ctx))
            raise click.UsageError(f"no command {args[0]!r}; there are: {known}{self.others}", ctx)
        return super().resolve_command(ctx, args)


class OrderedGroup(Listing):
    """Group that lists its commands in the order of definition, which is that of use."""

    command_class = Signed

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Commands in the order of their definition."""
        return list(self.commands)


class Group(OrderedGroup):
    """Group that reports a ContactdError in one line on stderr with its exit status."""

    command_class = Command
    others = "; identify, check, plot and more are commands of `contactd`"

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; a ContactdError determines the exit status."""
        _open_closed_streams()
        try:
            with read_to_the_end():
                return super().invoke(ctx)
        except ContactdError as error:
            say(f"contactctl: {error}", err=True)
            ctx.exit(error.exit_code)
        except UnicodeEncodeError as error:
            word = error.object[max(error.start - 40, 0) : error.start + 40]
            raise click.UsageError(f"{word!r} is not {error.encoding} text", ctx) from error
        except OSError as error:
            if not (text := write_failure(error)):
                raise
            say(f"contactctl: {text}", err=True)
            ctx.exit(LogError.exit_code)


def _open_closed_streams() -> None:
    """Open standard streams that the caller closed (`contactctl stop >&-`), so that commands do not
    fail, and no socket takes their file descriptors."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 - as long as the program runs


class Range(click.FloatRange):
    """Number within bounds; refuses NaN, which passes all comparisons of `FloatRange`."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert a value. Raises BadParameter with value and range; click adds the option."""
        try:
            number = float(value)
        except ValueError:
            self.fail(f"{value!r} is not a number.", param, ctx)
        if math.isnan(number) and (self.min is not None or self.max is not None):
            self.fail(f"{number} is not in the range {self._describe_range()}.", param, ctx)
        return super().convert(value, param, ctx)
