"""`contactd`: the command line of the daemon, of its configuration and of its recordings."""
# ruff: noqa: PLC0415 - each command imports what it needs, so that `--help` starts at once

import os
import sys
import traceback
from pathlib import Path
from typing import Any

import click

from common.compiled import refuse_stale
from common.errors import ContactdError, LogError, ProgramError
from common.numeric_threads import single_threaded
from programs.command_line.options import PATH, SOCKET, Listing, Range
from programs.command_line.sentences import read_to_the_end, say, write_failure
from programs.contactd import recordings
from programs.contactd.fleet import fleet
from programs.contactd.new_command import new
from programs.contactd.shapes import shapes
from programs.identify.command import identify

DEMOS = ("romeo_left_arm", "openarm_left", "beam_arm")
ENDED_BY_CTRL_C = 130  # exit status by shell convention: 128 + SIGINT
CONFIG = click.argument("config", type=PATH)
PORT = click.option(
    "--port",
    type=click.IntRange(1, 65535),
    help="TCP port of a socketcand bus, instead of the configured one.",
)


class _Group(Listing):
    """Command group that reports a ContactdError as a message on stderr with its exit status, and
    any other exception as a traceback with the exit status of a program error."""

    others = "; enable, arm, start, status and more are commands of `contactctl`"

    def invoke(self, ctx: click.Context) -> Any:
        single_threaded()  # must precede the import of numpy
        try:
            refuse_stale()
            with read_to_the_end():
                return super().invoke(ctx)
        except ContactdError as error:
            from daemon.service.journal import stderr_is_journal

            head = "<3>" if stderr_is_journal() else "contactd: "
            for line in str(error).splitlines():
                say(head + line, err=True)
            ctx.exit(error.exit_code)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except KeyboardInterrupt:
            ctx.exit(ENDED_BY_CTRL_C)
        except Exception as error:
            if isinstance(error, OSError) and (text := write_failure(error)):
                say(f"contactd: {text}", err=True)
                ctx.exit(LogError.exit_code)
            click.echo(traceback.format_exc(), err=True, nl=False)
            ctx.exit(ProgramError.exit_code)


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="contactd", prog_name="contactd")
def main() -> None:
    """Sensorless contact daemon for low-cost robot arms with joint backlash.

    CONFIG is a robot's config.yaml, or the folder that holds it.

    This program is not a certified safety function: an arm needs a hardware emergency stop within
    reach. Exit status: 0 done, 1 failed, 2 usage, 65 a file is bad or cannot be written, 69 no bus
    or no daemon, 70 error in the program, 78 wrong configuration, 141 the reader closed the pipe
    before the end (`| head`).
    """


@main.command()
@CONFIG
@SOCKET
@PORT
def run(config: Path, socket: Path | None, port: int | None) -> None:
    """Run the daemon: set up the drives, then detect contact. It energises and moves nothing by
    itself."""
    from daemon.service.notify import failure_reported

    with failure_reported(os.environ, os.getpid()):
        from daemon.config.load import load_robot
        from daemon.run import run_daemon

        run_daemon(lambda: load_robot(config).with_port(port), socket)


@main.command()
@CONFIG
@PORT
def guard(config: Path, port: int | None) -> None:
    """Guard an arm whose motors let go when they receive no frames; runs beside the daemon.

    While the daemon is silent, the guardian repeats the last setpoints with zero velocity, so that
    the arm holds its position; motors that are hot, or have held for ten minutes, are lowered
    slowly in the direction of their load. As soon as the daemon is back, it takes over again.
    Without a guardian `contactctl arm` is refused.
    """
    from programs.contactd.guard import run_guard

    run_guard(config, port)


@main.command()
@click.argument("config", type=PATH, required=False)
@click.option(
    "--explain",
    "field",
    metavar="FIELD",
    help="Explain a field instead: its meaning, how to find it, and typical values.",
)
def check(config: Path | None, field: str | None) -> None:
    """Check a configuration and print what follows from it.

    That is: quantities, PDOs, bus load, gravity loads, the stopping travel of each joint if its
    drive or the daemon fails, the smallest force that is detected, values near their bounds, likely
    mistakes, and why `arm` would be refused.
    """
    from programs.contactd.check import print_check, print_explanation

    if field is not None:
        print_explanation(field)
    elif config is None:
        raise click.UsageError("Missing argument 'CONFIG'.")
    else:
        print_check(config)


@main.command()
@CONFIG
@PORT
def scan(config: Path, port: int | None) -> None:
    """List the nodes on the bus of CONFIG: node ID, vendor, product, serial number, modes, and the
    matching EDS files in the folder; also motors of other makes.

    The scan only reads, by SDO, and is refused while a master is on the bus. Of CONFIG only `bus`
    is read: the rest may still contain errors.
    """
    from programs.contactd.scan import run_scan

    run_scan(config, port)


@main.command()
@CONFIG
@PORT
@click.option("--seed", type=click.IntRange(min=0), help="Seed of noise and mismatch.")
@click.option(
    "--friction",
    type=click.Choice(["smooth", "dahl"]),
    help="Smooth Coulomb friction, or true stiction.",
)
@click.option(
    "--hand",
    type=PATH,
    metavar="FILE",
    help="Script of a simulated hand (YAML); its clock starts with the arm's first motion.",
)
@click.option(
    "--hand-socket",
    "door",
    type=PATH,
    metavar="PATH",
    help="Socket for `contactctl hand`, instead of the default.",
)
@click.option(
    "--write-truth",
    is_flag=True,
    help="Only write simulation.yaml, the true arm, from the present config.yaml.",
)
def simulate(
    config: Path,
    port: int | None,
    seed: int | None,
    friction: str | None,
    hand: Path | None,
    door: Path | None,
    write_truth: bool,
) -> None:
    """Simulate in real time the arm that simulation.yaml beside CONFIG describes, on CONFIG's bus.
    Of CONFIG only the bus is used: corrections to it do not change the simulated arm.

    A socketcand bus is served over TCP; the simulated drives join a socketcan bus. Events of the
    arm are printed as lines of JSON.
    """
    if write_truth:
        from daemon.config.load import load_robot
        from programs.simulate import simulated_robot

        click.echo(f"wrote {simulated_robot.write_truth(load_robot(config))}")
        return

    from daemon.config.load import load_robot
    from programs.simulate.simulate import run_simulation

    run_simulation(load_robot(config).with_port(port), seed, friction, hand, door)


@main.command()
@click.option(
    "--arm", type=click.Choice(DEMOS), default=DEMOS[0], show_default=True,
    help="Arm of configs/: CANopen drives, or Damiao or RobStride motors and their guardian.",
)  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Report as one line of JSON at the end.")
@click.option(
    "--seconds", type=Range(min=25, max=600), default=32.0, show_default=True,
    help="Length of the demonstration.",
)  # fmt: skip
@click.option("--record", "file", type=PATH, metavar="FILE.mcap", help="Record it to a new file.")
@click.option("--web", is_flag=True, help="Also show it on the web page, and print its address.")
@click.option(
    "--web-port", type=click.IntRange(0, 65535), default=8420, show_default=True,
    help="Port of the page; 0 takes a free one.",
)  # fmt: skip
def demo(
    arm: str, as_json: bool, seconds: float, file: Path | None, web: bool, web_port: int
) -> None:
    """The paper's third experiment: a hand pushes, guides and releases a simulated arm.

    Simulator and daemon are two processes that communicate over CAN in real time; the web page is
    a third. Exit status 0 only if every step took place, 130 if Ctrl-C ended it.
    """
    from programs.demo.demo import run_demo

    port = web_port if web else None
    try:
        happened = run_demo(as_json=as_json, seconds=seconds, arm=arm, file=file, page_port=port)
    except KeyboardInterrupt:
        click.echo("ended by Ctrl-C", err=True)
        sys.exit(ENDED_BY_CTRL_C)
    sys.exit(0 if happened else 1)


@main.command("black-box")
@SOCKET
@click.option(
    "--output",
    type=PATH,
    metavar="FILE",
    help="Log to write: .blf, .log (candump), .asc; by default a new one in the state directory.",
)
@click.option(
    "--left-over",
    is_flag=True,
    help="Save only unsaved frames of a daemon that died; for service managers.",
)
def black_box(socket: Path | None, output: Path | None, left_over: bool) -> None:
    """Write the CAN frames of the last minute to a log file of python-can.

    A running daemon keeps them in memory; they are saved automatically after every fault and when
    the daemon dies. This command saves them at any other time. `python -m can.logconvert` converts
    a log to another format.
    """
    from programs.contactd.black_box import write_frames

    write_frames(socket, output, left_over=left_over)


for command in (*recordings.COMMANDS, fleet, new, identify, shapes):
    main.add_command(command)


if __name__ == "__main__":
    main(prog_name="contactd")
