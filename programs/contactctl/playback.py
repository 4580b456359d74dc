"""`contactctl playback`: records a lead until the arm holds again, and runs the smoothed path."""
# ruff: noqa: PLC0415 - numpy and the client are imported by the command that needs them

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from common.errors import TrajectoryError
from daemon.modes.table import GUIDED
from daemon.protocol.bounds import SLOWEST
from programs.command_line.options import PATH, Command, Options, Range
from programs.command_line.sentences import say
from programs.contactctl.go import move
from programs.contactctl.replies import answer

if TYPE_CHECKING:
    from daemon.motion.trajectory_file import TrajectoryFile
    from daemon.protocol.state import State
    from programs.clients.client import Client

SLOWER = 0.8  # factor from one speed that is tried to the next


@click.command(cls=Command)
@click.argument("file", type=PATH, metavar="FILE")
@click.option(
    "--speed",
    type=Range(min=SLOWEST, max=1.0),
    metavar="SHARE",
    help="Fraction of the led speed; by default the largest within the limits.",
)
@click.option("--yes", is_flag=True, help="Do not ask, for scripts.")
@click.pass_obj
def playback(options: Options, file: Path, speed: float | None, yes: bool) -> None:
    """Repeat a lead: after confirmation the arm moves to its first pose, then as it was led.

    If FILE does not exist, a lead of the armed arm is recorded first. The path is checked for
    collisions only if the arm has shapes.
    """
    from daemon.motion.trajectory_file import read_trajectory
    from programs.clients.led_path import led_path

    if not os.path.exists(file):  # False, too, for a name that cannot be looked up
        _record_lead(options, file)
    with options.connect() as client:
        recorded = read_trajectory(file, client.ask_status().joints)
        times, positions = led_path(recorded.times, recorded.positions)
        if not times:
            hint = "delete the file to record a lead"
            raise TrajectoryError(f"{file}: no joint moves in it; {hint}")
        speed = _fastest(client, recorded, times, positions) if speed is None else speed
    if not options.json:
        kept = f"{len(times)} of {len(recorded.times)} samples"
        say(f"{file.name}: {kept}, {times[-1] / speed:.1f} s, at {speed:.0%} of its speed")
    begin = zip(recorded.joints, positions[0], strict=True)
    move(options, [f"{joint}={at:.6f}" for joint, at in begin], 0.2, yes=yes)
    with options.connect() as client:
        _load(client, recorded, times, positions, speed)
        answer(options, client.start_loaded())


def _record_lead(options: Options, file: Path) -> None:
    """Record until the arm, once led, holds or tracks again."""
    from programs.clients.trajectory_recorder import record_trajectory

    led = False

    def over(state: "State") -> bool:
        nonlocal led
        before, led = led, led or state.mode in GUIDED
        return before and state.mode not in GUIDED

    with options.connect() as client:
        if not client.ask_status().armed:
            raise click.UsageError(f"no {file} to repeat; to record a lead, `contactctl arm` first")
    say("lead the arm; the recording ends when it holds or continues", err=True)
    made = record_trajectory(options.connect, file, until=over)
    say(f"{file}: {made}", err=True)


def _fastest(
    client: "Client", recorded: "TrajectoryFile", times: list[float], positions: list[list[float]]
) -> float:
    """Largest fraction of the led speed that the limits allow, of those tried. Raises
    TrajectoryError."""
    speed = 1.0
    while True:
        try:
            _load(client, recorded, times, positions, speed)
        except TrajectoryError as error:
            if "outside its limits" in str(error):
                hint = f"delete {recorded.path} and lead the arm less far"
                raise TrajectoryError(f"{error}; {hint}") from error
            if speed * SLOWER < SLOWEST or "limit" not in str(error):
                raise
            speed *= SLOWER
        else:
            return speed


def _load(
    client: "Client",
    recorded: "TrajectoryFile",
    times: list[float],
    positions: list[list[float]],
    speed: float,
) -> None:
    slower = [time_s / speed for time_s in times]
    client.load_trajectory(recorded.joints, slower, positions, name=recorded.path.name)
