"""Options shared by the programs that use Zenoh: router, domain and distribution."""

from collections.abc import Callable
from typing import Any

import click

from programs.command_line.options import PATH

DISTROS = ("humble", "jazzy", "kilted", "rolling")

_OPTIONS = (
    click.option(
        "--connect",
        multiple=True,
        default=("tcp/localhost:7447",),
        show_default=True,
        metavar="ENDPOINT",
        help="Zenoh router; may be repeated.",
    ),
    click.option(
        "--config",
        "configuration",
        type=PATH,
        metavar="FILE.json5",
        help="Configuration of the Zenoh session (TLS, access control), instead of --connect.",
    ),
    click.option(
        "--domain", type=click.IntRange(0, 232), default=0, show_default=True, help="ROS_DOMAIN_ID."
    ),
    click.option(
        "--distro",
        type=click.Choice(DISTROS),
        default="jazzy",
        show_default=True,
        help="ROS 2 distribution of the other nodes; Humble has no type hashes.",
    ),
)


def zenoh_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator that adds the options `connect`, `configuration`, `domain` and `distro`."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command
