"""Commands of `contactd` on recordings: replay, plot, whatif, export."""
# ruff: noqa: PLC0415 - each command imports what it needs, so that `--help` starts at once

import sys
from pathlib import Path
from typing import Any

import click

from programs.command_line.options import PATH, Range

_FRAMES = (".blf", ".log", ".asc")


def _recording(_: click.Context, __: click.Parameter, file: Path | None) -> Path | None:
    """Path of a recording; a black-box log is converted to one."""
    if file is None or file.suffix.lower() not in _FRAMES:
        return file
    from programs.recordings.recomputed import as_recording

    return as_recording(file)


def _recordings(
    context: click.Context, param: click.Parameter, files: tuple[Path, ...]
) -> tuple[Path | None, ...]:
    return tuple(_recording(context, param, file) for file in files)


def _by_config(file: Path, config: Path | None) -> bool:
    """True for a log of another program. Raises UsageError if such a log lacks --config, or a
    recording has it."""
    from programs.identify.log_names import is_foreign

    foreign = is_foreign(file)
    if foreign and config is None:
        raise click.UsageError("a log of another program needs --config: the robot's folder")
    if config is not None and not foreign:
        raise click.UsageError("--config is for a log of another program: a recording has its own")
    return foreign


FILE = click.argument("file", type=PATH, callback=_recording)
CONFIG = click.option(
    "--config", type=PATH, help="Robot's folder, for logs of other programs (docs/logs.md)."
)


@click.command()
@FILE
@CONFIG
@click.option("--json", "as_json", is_flag=True, help="Report as one line of JSON.")
def replay(file: Path, config: Path | None, as_json: bool) -> None:
    """Summarise a recording, and check that its estimates are reproduced.

    Shows duration, modes, contacts with joint, torque and duration, faults, lost states. Then the
    estimator runs over the samples again: the result must be bit-identical, or the first difference
    is shown. Exit status 0 only if the recording is complete and bit-identical; 65 for one that
    this version cannot compare.

    Of a log of another program: residuals and contacts according to the estimator of --config.
    """
    if _by_config(file, config) and config is not None:
        from programs.contactd.replay_log import print_log

        print_log(file, config, as_json=as_json)
        return
    from programs.contactd.replay import print_replay

    sys.exit(0 if print_replay(file, as_json=as_json) else 1)


def _around(_: click.Context, __: click.Parameter, value: str) -> str:
    from programs.recordings.view import AROUND

    if value and not AROUND.fullmatch(value):
        raise click.BadParameter(
            f"{value!r} is not a time in seconds, contact:N, fault or fault:N (N from 1)"
        )
    return value


@click.command()
@click.argument("file", type=PATH, required=False, callback=_recording)
@click.option(
    "--last-fault",
    is_flag=True,
    help="Plot the newest black-box log that has a fault, around that fault unless --around is "
    "given; without a fault, the newest log.",
)
@CONFIG
@click.option(
    "--joint",
    "joints",
    multiple=True,
    metavar="NAME",
    help="Only this joint, by name or by number from 1; may be repeated.",
)
@click.option(
    "--around",
    default="",
    metavar="WHERE",
    callback=_around,
    help="Plot only around this: a time in seconds from the beginning, contact:N as numbered by "
    "`replay`, fault (the first) or fault:N. Also prints each joint's values at that time.",
)
@click.option(
    "--window",
    "window_s",
    type=Range(min=0.1, max=3600),
    default=5.0,
    show_default=True,
    metavar="S",
    help="Length of the section shown around it.",
)
@click.option(
    "-o",
    "--output",
    type=PATH,
    metavar="FILE",
    help="FILE.html, .png or .svg; by default the recording's name with .html, in this folder.",
)
def plot(
    file: Path | None,
    last_fault: bool,
    config: Path | None,
    joints: tuple[str, ...],
    around: str,
    window_s: float,
    output: Path | None,
) -> None:
    """Plot a recording: residual and threshold, velocity, current, gap, modes, contacts, faults.

    A page (.html) is one file that needs no network: zoom by dragging, choose joints, click an
    event. FILE may be a black-box log (.blf): its frames are decoded and the estimator runs over
    them afresh. PNG and SVG need matplotlib (extra `plot`), and show the joints that were touched
    unless --joint is given.
    """
    from programs.contactd.plot import newest_fault, plot_recording

    if (file is None) != last_fault or (last_fault and config):
        raise click.UsageError("name one recording, or --last-fault")
    if file is None:
        file, around = newest_fault(around)
    elif _by_config(file, config) and config is not None:
        from programs.identify.foreign import recording_of

        output = output or Path(f"{file.stem}.html")
        file = recording_of(file, config)
    sys.exit(0 if plot_recording(file, joints, around, window_s, output) else 1)


@click.command()
@click.argument("places", nargs=-1, required=True, type=PATH, metavar="FILE|DIR...")
@click.option(
    "--threshold",
    "thresholds",
    multiple=True,
    metavar="JOINT=LOW:HIGH:STEP",
    help="Other contact levels of a joint [Nm], or JOINT=A,B; may be repeated.",
)
@click.option(
    "--collision",
    "collisions",
    multiple=True,
    metavar="JOINT=LOW:HIGH:STEP",
    help="Other collision levels of a joint, likewise.",
)
@click.option(
    "--residual",
    default="",
    metavar="NAME",
    help="Another residual computed alongside, such as classical or two_mass.",
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="PATH=VALUE",
    help="Another setting, such as joints.LElbowYaw.friction.motor_coulomb=0.4, "
    "estimator.gain=20, or identified=FILE: replays the samples. May be repeated.",
)
@click.option(
    "--fresh", is_flag=True, help="Replay as after switching on, without the learned state."
)
@click.option(
    "--until-reaction",
    is_flag=True,
    help="Leave out all samples after the arm's first reaction to a contact.",
)
@click.option(
    "--labels",
    type=PATH,
    metavar="FILE.csv",
    help="Touches of the arm: file, start_s, end_s, joint (or any).",
)
@click.option(
    "--propose-labels",
    "proposal",
    type=PATH,
    metavar="FILE.csv",
    help="Only write the recorded contacts as such a file, to be corrected.",
)
@click.option(
    "--per-hour",
    type=Range(min=0),
    default=1.0,
    show_default=True,
    help="Acceptable false contacts per hour, which determine the chosen level.",
)
@click.option(
    "--workers",
    type=click.IntRange(1, 1024),
    default=1,
    show_default=True,
    help="Processes on this machine (extra `cluster`).",
)
@click.option(
    "--scheduler",
    default="",
    metavar="tcp://HOST:PORT",
    help="Use the workers of a dask cluster instead (extra `cluster`).",
)
@click.option("-o", "--output", type=PATH, metavar="FILE.html", help="Also plot the curves.")
@CONFIG
@click.option("--json", "as_json", is_flag=True, help="Report as one line of JSON.")  # fmt: skip
def whatif(proposal: Path | None, **asked: Any) -> None:
    """Report which contacts recordings would have had at other levels or with other settings.

    Of a folder, all .mcap files below it are read, with --config all .csv files. A level replaces
    the configured one without the estimator: how it was raised and lowered is taken as recorded.
    Settings are replayed. All that follows the arm's first reaction is hypothetical: it would have
    moved differently.

    A recording that cannot be read is reported and skipped; the exit status is then 1. Answers are
    cached for the user, so that an interrupted run can be continued.
    """
    from programs.contactd.whatif import Request, print_whatif, write_template

    if proposal is not None:
        sys.exit(0 if write_template(asked["places"], proposal, asked["config"]) else 1)
    sys.exit(0 if print_whatif(Request(**asked)) else 1)


@click.command()
@click.argument(
    "files", type=PATH, nargs=-1, required=True, metavar="FILE ...", callback=_recordings
)
@click.option(
    "--foxglove",
    "form",
    flag_value="foxglove",
    help="MCAP in Foxglove's own schemas: the arm in 3D with the touched link highlighted, joint "
    "states, named values, log (extra `foxglove`).",
)
@click.option(
    "--csv",
    "form",
    flag_value="csv",
    help="CSV with one row per tick; `contactd identify --log` reads it, too.",
)
@click.option(
    "--labels",
    "form",
    flag_value="labels",
    help="Contacts as labels, to be corrected for `whatif --labels`.",
)
@click.option("--lerobot", "dataset", type=PATH, metavar="DIR",
              help="A new LeRobot dataset with one episode per FILE.")  # fmt: skip
@click.option("--fps", type=Range(1, 200), default=50, show_default=True,
              help="Frames of the dataset per second.")  # fmt: skip
@click.option("--task", default="recorded with contactd", show_default=True, metavar="TEXT",
              help="Task of the dataset's episodes.")  # fmt: skip
@click.option("-o", "--output", type=PATH, metavar="FILE",
              help="A new file; by default named after the recording, here.")  # fmt: skip
def export(
    files: tuple[Path, ...],
    form: str | None,
    dataset: Path | None,
    fps: float,
    task: str,
    output: Path | None,
) -> None:
    """Convert a recording for other programs. No file is overwritten."""
    from programs.contactd.export import export_dataset, export_recording

    if (form is None) == (dataset is None):
        raise click.UsageError("name one form: --foxglove, --csv, --labels or --lerobot")
    if dataset is not None:
        if output is not None:
            raise click.UsageError("--lerobot names its folder: no --output")
        sys.exit(0 if export_dataset(files, dataset, round(fps), task) else 1)
    if len(files) > 1:
        raise click.UsageError("only --lerobot takes several recordings")
    sys.exit(0 if export_recording(files[0], str(form), output) else 1)


COMMANDS = (replay, plot, whatif, export)
