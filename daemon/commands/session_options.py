"""The options that all commands of `contactctl` take, before or behind the command."""
# ruff: noqa: PLC0415 - the client is imported by the command that needs it

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from daemon.commands.paths import PATH
from errors import ContactdError

if TYPE_CHECKING:
    from daemon.clients.client import Client


@dataclass(frozen=True, slots=True)
class Options:
    """What was said before the command."""

    socket: Path | None
    json: bool

    def connect(self) -> "Client":
        """A connection to the daemon. Raises UnreachableError."""
        from daemon.clients.client import Client

        return Client(self.socket)


def _take_json(ctx: click.Context, _: click.Parameter, given: bool) -> None:
    if given:
        ctx.obj = replace(ctx.obj, json=True)


def _take_socket(ctx: click.Context, _: click.Parameter, given: Path | None) -> None:
    if given is not None:
        ctx.obj = replace(ctx.obj, socket=given)


class Command(click.Command):
    """Takes the options of all commands, too, so that they may stand before or behind it."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self.params += [socket_option(_take_socket), json_option(_take_json)]


def socket_option(callback: Any = None) -> click.Option:
    """--socket."""
    return click.Option(
        ["--socket"],
        type=PATH,
        metavar="PATH",
        help="The daemon's control socket, where it is not the usual one.",
        callback=callback,
        expose_value=callback is None,
    )


def json_option(callback: Any = None) -> click.Option:
    """--json."""
    return click.Option(
        ["--json", "as_json"],
        is_flag=True,
        help="Answer in one line of JSON, for programs.",
        callback=callback,
        expose_value=callback is None,
    )


class Group(click.Group):
    """Lists the commands in the order of a session; one line on stderr for each of our errors."""

    command_class = Command

    def list_commands(self, ctx: click.Context) -> list[str]:
        """In the order in which they were defined."""
        return list(self.commands)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; an error of ours gives the exit status."""
        try:
            return super().invoke(ctx)
        except ContactdError as error:
            click.echo(f"contactctl: {error}", err=True)
            ctx.exit(error.exit_code)
