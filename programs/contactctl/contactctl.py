"""`contactctl`: command line for a person who operates the arm.

Slow imports are made by the command that needs them, so that the others start at once.
"""
# ruff: noqa: PLC0415

import sys
from pathlib import Path

import click

from common.errors import TrajectoryError
from daemon.protocol.lease import LONGEST_S, PERSON_S, SHORTEST_S
from programs.command_line.options import PATH, Group, Options, Range, json_option, socket_option
from programs.contactctl.follow import follow
from programs.contactctl.gain import gain
from programs.contactctl.go import go, home
from programs.contactctl.guide import guide
from programs.contactctl.hand import hand
from programs.contactctl.live_states import record, touches, watch
from programs.contactctl.payload import payload
from programs.contactctl.playback import playback
from programs.contactctl.replies import (
    answer,
    carry_out,
    print_json,
    take_up_changes,
    wait_until_sensing,
)


@click.group(
    cls=Group,
    context_settings={"help_option_names": ["-h", "--help"]},
    params=[socket_option(), json_option()],
)
@click.version_option(package_name="contactd", prog_name="contactctl")
@click.pass_context
def main(ctx: click.Context, socket: Path | None, as_json: bool) -> None:
    """Control contactd, the daemon that detects contact on a robot arm.

    A typical session: enable, arm, start; then pause or stop; then disable. This program is not a
    certified safety function: keep the hardware emergency stop within reach.

    Exit status: 0 done, 1 refused or not done, 2 usage, 65 a file is bad or cannot be written,
    69 the daemon cannot be reached, 141 the reader closed the pipe before the end (`| head`).
    """
    ctx.obj = Options(socket, as_json)


_no_wait = click.option("--no-wait", is_flag=True, help="Return at once, without waiting.")
_no_wait_to_stand = click.option(
    "--no-wait",
    is_flag=True,
    help="Return at once, without waiting; exit status 1 if a joint commanded to stop is not yet "
    "confirmed at standstill.",
)


@main.command()
@_no_wait
@click.pass_obj
def enable(options: Options, no_wait: bool) -> None:
    """Energise the drives: the arm holds its position and senses contact, so that it can be armed.

    If the daemon's files were changed since it read them, they are loaded first: see `reload`.
    """
    take_up_changes(options)
    carry_out(options, "enable", wait=not no_wait)
    if not no_wait:
        wait_until_sensing(options)


@main.command()
@click.option(
    "--lease",
    "lease_s",
    type=Range(min=SHORTEST_S, max=LONGEST_S),
    default=PERSON_S,
    show_default=True,
    metavar="S",
    help="How long the arm stays armed, in seconds, unless you arm again.",
)
@click.pass_obj
def arm(options: Options, lease_s: float) -> None:
    """Let the arm yield to contact. Refused, with all reasons, if a check fails.

    Shows each check as passed or failed, then the smallest contact that is detected: the torque of
    each joint and, in this pose, the force at the tool, in motion and at rest. Arming again renews
    the lease; it is refused while another client holds the lease. When the lease expires the arm is
    disarmed, and holds if it is being led.
    """
    with options.connect() as client:
        reply = client.arm(lease_s, detached=True)
    answer(options, reply)


@main.command()
@click.argument("file", required=False, type=PATH, metavar="[FILE.csv]")
@click.option(
    "--from-here", is_flag=True, help="Run the file as displacements from the arm's present pose."
)
@click.option(
    "--speed",
    type=Range(min=0.01, max=1),
    default=1.0,
    show_default=True,
    metavar="X",
    help="Run the file slower, at this fraction of its speed.",
)
@click.pass_obj
def start(options: Options, file: Path | None, from_here: bool, speed: float) -> None:
    """Start a trajectory: the arm moves.

    Without a file, a paused trajectory continues, or else the configured one begins. A file has a
    column time_s [s] and one for each joint that moves [rad]; it is checked against all limits
    before anything moves, and the arm must stand at its first pose.
    """
    if file is None:
        if from_here or speed != 1.0:
            raise click.UsageError("--from-here and --speed require a file")
        carry_out(options, "start")
        return
    from daemon.motion.trajectory_file import read_trajectory

    with options.connect() as client:
        trajectory = read_trajectory(file, client.ask_status().joints)
        try:
            client.load_trajectory(
                trajectory.joints,
                [time_s / speed for time_s in trajectory.times],
                trajectory.positions,
                name=file.name,
                from_here=from_here,
            )
        except TrajectoryError as error:
            raise trajectory.placed(error) from error
        answer(options, client.start_loaded())


@main.command()
@_no_wait
@click.pass_obj
def pause(options: Options, no_wait: bool) -> None:
    """Halt the trajectory; the arm stays armed. `start` continues it, `stop` discards it."""
    carry_out(options, "pause", wait=not no_wait)


@main.command()
@_no_wait_to_stand
@click.pass_obj
def disarm(options: Options, no_wait: bool) -> None:
    """Stop yielding to contact. Contacts are still reported, and collisions still reacted to.

    An arm that is being led stops. Exit status 1 if it is not confirmed at standstill.
    """
    carry_out(options, "disarm", wait=not no_wait)


@main.command()
@_no_wait_to_stand
@click.pass_obj
def stop(options: Options, no_wait: bool) -> None:
    """Stop the arm at once, and disarm it. Works in every mode.

    Exit status 1 if joints are not confirmed at standstill; they are named: press the emergency
    stop if anything moves.
    """
    carry_out(options, "stop", wait=not no_wait)


@main.command()
@_no_wait_to_stand
@click.pass_obj
def disable(options: Options, no_wait: bool) -> None:
    """Switch the drives off: joints end as configured, held by their drives, braked, or limp.

    Exit status 1 if joints are not confirmed at standstill; they are named.
    """
    carry_out(options, "disable", wait=not no_wait)


@main.command()
@click.pass_obj
def reset(options: Options) -> None:
    """Acknowledge a fault. Energises and moves nothing.

    First reads back the settings of the drives, and sets up again drives that lost them, which may
    take seconds. Clears emergency messages of drives that are not in fault.
    """
    carry_out(options, "reset")


for command in (go, home, follow, playback, gain, guide, payload):
    main.add_command(command)


@main.command()
@click.pass_obj
def reload(options: Options) -> None:
    """Reload the daemon's files, with the drives off, and set up the drives accordingly.

    Edited or newly identified values take effect as after a restart of the daemon: all connections
    to it end. If the files cannot be read, or the drives cannot be set up with them, they are
    rejected: exit status 1 with the reason, and the daemon stays off until a reload succeeds.
    """
    from daemon.protocol.replies import Reply
    from programs.clients.reload import reload as read_anew

    with options.connect() as client:
        changed = client.ask_status().changed
    found = read_anew(options.socket)
    text = f"taken up: {', '.join(changed)}" if changed else "files read again, nothing had changed"
    answer(options, Reply(ok=True, message=f"reload: {text}", mode=found.mode))


@main.command()
@click.pass_obj
def status(options: Options) -> None:
    """Show mode, joints, and what arming needs."""
    with options.connect() as client:
        found, path = client.ask_status(), client.path
        if options.json:
            print_json(found)
            return
        from programs.clients.status_report import status_head, status_report
        from programs.command_line.console import on_stdout
        from programs.contactctl.point import point_now

        console, report = on_stdout(), status_report(found, path, point_now(client, found))
    console.print(report)
    # On a terminal too small for the report, its head is repeated at the end.
    if console.is_terminal and len(console.render_lines(report)) >= console.height:
        console.print(status_head(found))


@main.command()
@click.option(
    "--directory",
    type=PATH,
    metavar="DIR",
    help="State directory of the daemon, instead of the default.",
)
@click.option("--plot", type=PATH, metavar="FILE.png", help="Plot the days to a new file.")
@click.pass_obj
def health(options: Options, directory: Path | None, plot: Path | None) -> None:
    """Show how the gears age: each joint compared with the days of its identification.

    Reads the records that the daemon writes each day; it need not be running. Exit status 1 if
    there is a warning for a joint, 65 if there are no records, or none of an arm is readable.
    """
    from programs.contactctl.health import show_health

    sys.exit(show_health(directory, plot, as_json=options.json))


main.add_command(watch)
main.add_command(touches)
main.add_command(record)
main.add_command(hand)

if __name__ == "__main__":
    main(prog_name="contactctl")
