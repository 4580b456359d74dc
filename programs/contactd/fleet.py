"""`contactd fleet`: lists all arms at a Zenoh router, and stops some or all of them."""
# ruff: noqa: PLC0415 - zenoh is an extra, and rich is slow to import

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from common.errors import ConfigurationError, UnreachableError
from programs.contactctl.replies import print_json
from programs.zenoh.zenoh_options import zenoh_options

if TYPE_CHECKING:
    from rich.table import Table

    from programs.zenoh.fleet import Arm
    from programs.zenoh.supervisor import Supervisor

#: Every arm publishes at least once a second; longest wait for one that is held up.
LISTEN_S: Final = 1.5
HELD_UP_S: Final = 8.0
TIMEOUT_MS: Final = 3000
FRAME_S: Final = 0.5


@click.command()
@click.argument("arms", nargs=-1, metavar="[ARM]...")
@click.option("--stop", is_flag=True, help="Stop these arms; with --all every one that is alive.")
@click.option("--all", "every", is_flag=True, help="With --stop: every arm.")
@click.option("--watch", is_flag=True, help="Show them live, until Ctrl-C.")
@click.option("--json", "as_json", is_flag=True, help="Answer in one line of JSON.")
@zenoh_options
def fleet(
    arms: tuple[str, ...], stop: bool, every: bool, watch: bool, as_json: bool, **router: Any
) -> None:
    """Show all arms with a `contactd-zenoh` at a Zenoh router, or stop some or all of them.

    Shows for each arm: alive or since when silent, mode, armed, message, and last contact. ARM is a
    namespace. Exit status of a stop: 0 if every arm stands, 1 if one does not or does not answer,
    69 if there was none. This is not an emergency stop.
    """
    if stop != (bool(arms) or every) or (arms and every) or (watch and (stop or as_json)):
        raise click.UsageError("give no option, or --watch, --stop ARM..., or --stop --all")

    def use(supervisor: "Supervisor") -> int:
        if stop:
            return _stop(supervisor, arms, as_json=as_json)
        return _watch(supervisor) if watch else _show(supervisor, as_json=as_json)

    sys.exit(_with_supervisor(use, **router))


def _with_supervisor(
    use: Callable[["Supervisor"], int],
    *,
    connect: tuple[str, ...],
    configuration: Path | None,
    domain: int,
    distro: str,
) -> int:
    """Exit status of `use`, called with a Supervisor of the arms at this router. Raises
    UnreachableError without a router, ConfigurationError if the extra `ros` is not installed."""
    try:
        from programs.zenoh.names import Distro
        from programs.zenoh.supervisor import supervising
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            f"`fleet` needs the extra `ros` ({error.name}): pip install 'contactd[ros]'"
        ) from error
    with supervising(connect, configuration, domain, Distro(distro), TIMEOUT_MS) as supervisor:
        return use(supervisor)


def _show(supervisor: "Supervisor", *, as_json: bool) -> int:
    """Listen until each arm has reported, and print a line for each; 69 if there is none."""
    arms = reported(supervisor.arms, time.monotonic, time.sleep)
    if as_json:
        print_json([_row(arm, time.monotonic()) for arm in arms])
    elif arms:
        from programs.command_line.console import on_stdout

        on_stdout(width=160).print(table(arms, time.monotonic()))
    else:
        click.echo("contactd: no arm found at this router", err=True)
    return 0 if arms else UnreachableError.exit_code


def reported(
    arms: Callable[[], Sequence["Arm"]], now_s: Callable[[], float], sleep: Callable[[float], None]
) -> Sequence["Arm"]:
    """Arms found, once each that is alive has reported, or HELD_UP_S have passed on the clock."""
    until_s = now_s() + HELD_UP_S
    sleep(LISTEN_S)
    while any(arm.alive and not arm.mode for arm in arms()) and now_s() < until_s:
        sleep(FRAME_S)
    return arms()


def _watch(supervisor: "Supervisor") -> int:
    """Show the table live until Ctrl-C."""
    from rich.live import Live

    with Live(screen=True, auto_refresh=False) as live:
        try:
            while True:
                live.update(table(supervisor.arms(), time.monotonic()), refresh=True)
                time.sleep(FRAME_S)
        except KeyboardInterrupt:
            return 0


def _stop(supervisor: "Supervisor", names: Sequence[str], *, as_json: bool) -> int:
    """Stop the named arms, or all that are alive, and print each outcome; returns 1 if one was not
    confirmed at standstill, 69 if there was none to stop."""
    found = supervisor.stop([name.strip("/") for name in names]) if names else supervisor.stop_all()
    if as_json:
        print_json({name: {"outcome": what, "text": text} for name, (what, text) in found.items()})
    for name, (outcome, text) in found.items() if not as_json else ():
        more = f" ({text})" if text and text != outcome else ""
        click.echo(f"{name:24} {outcome}{more}", err=outcome != "stands")
    if not found:
        click.echo("contactd: no arm is alive at this router", err=True)
        return UnreachableError.exit_code
    return 0 if all(outcome == "stands" for outcome, _ in found.values()) else 1


def table(arms: Sequence["Arm"], now_s: float) -> "Table":
    """Table of the arms."""
    from rich.table import Table
    from rich.text import Text

    made = Table("arm", "", "mode", "armed", "message", "last contact", box=None)
    for arm in arms:
        row = _row(arm, now_s)
        style = "dim" if row["silent_s"] is not None else {1: "yellow", 2: "red"}.get(arm.level, "")
        shown = {"true": "armed"}.get(arm.armed, "")
        cells = (arm.name, row["state"], arm.mode, shown, arm.says, arm.contact)
        made.add_row(*[Text(cell) for cell in cells], style=style)
    return made


def _row(arm: "Arm", now_s: float) -> dict[str, Any]:
    return {
        "arm": arm.name,
        "state": arm.state(now_s),
        "alive": arm.alive,
        "silent_s": arm.silent_s(now_s),
        "mode": arm.mode,
        "armed": arm.armed == "true",
        "level": arm.level.name,
        "text": arm.says,
        "contact": arm.contact,
    }
