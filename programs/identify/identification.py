"""Identification of one robot: common part of all steps of `contactd identify`."""

import signal
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import Self

import click
from rich.console import Console

from common.errors import ConfigurationError, ContactdError, ControlError, LogError
from common.new_file import locked
from daemon.config.evidence import outdated, unidentified
from daemon.config.identified import write_identified
from daemon.config.load import Robot, load_robot, refuse_unreadable
from daemon.config.schema import ArmingStep
from daemon.modes.table import Mode
from programs.clients.client import Client
from programs.command_line.console import on_stdout
from programs.command_line.questions import confirmed
from programs.command_line.sentences import say
from programs.identify.live_arm import LiveArm, open_session
from programs.identify.measured import Measured, read_measured
from programs.identify.merge import merged, merged_payloads
from programs.identify.overview import overview
from programs.identify.show import print_outcome, print_overview
from programs.identify.step import Outcome, now


class Identification:
    """Robot whose parameters are identified, on its `arm` or from `logs`, and the results."""

    def __init__(
        self, robot: Robot, console: Console, *, arm: LiveArm | None = None,
        logs: tuple[Path, ...] = (), dry: bool,
    ) -> None:  # fmt: skip
        self.robot, self.arm = robot, arm
        self.missed: list[str] = []
        """Joints without good results."""
        self._logs, self._console, self._dry = logs, console, dry
        self._folder = robot.folder / "identify"
        self._written: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: object
    ) -> None:
        """List what was written, also if a step was interrupted or, after the reason, failed, and
        close the arm. Adds the names of the logs to a LogError that contains none."""
        if kind is click.Abort:
            self.show("")  # ends the line of a question at which Ctrl-C was pressed
        path = self.robot.folder / self.robot.configuration.identified
        found = f"written to {path}: {', '.join(self._written)}"
        found += f"\nnot written: {', '.join(self.missed)}" if self.missed else ""
        found = found if self._written else f"nothing written to {path}"
        if isinstance(error, ContactdError):
            error.args = (f"{error}\n{found}",)
        else:
            self.show(found)
        well = kind is None or issubclass(kind, SystemExit)
        if self.arm is not None:
            self.arm.close(well=well, written=bool(self._written))
        named = any(f"{path.with_suffix('')}." in str(error) for path in self._logs)
        if isinstance(error, LogError) and self._logs and not named:
            raise type(error)(f"{', '.join(map(str, self._logs))}: {error}") from error

    def joints(self, named: tuple[str, ...]) -> list[str]:
        """Named joints, or all. Raises ConfigurationError for a joint that does not exist."""
        known = self.robot.configuration.joint_names
        for name in named:
            if name not in known:
                raise ConfigurationError(f"no joint {name}; there are: {', '.join(known)}")
        return list(named) or known

    def due(self, step: ArmingStep, named: tuple[str, ...]) -> list[str]:
        """Named joints; else, on a live arm, those whose step is missing or outdated; else all."""
        c, found = self.robot.configuration, self.robot.identified
        due = (*unidentified(step, found, c), *outdated(step, found, c, self.robot.urdf))
        return self.joints(named or (due if self.arm else ()))

    def measured(
        self, live: Callable[[LiveArm], Measured], *, gap_of: str = "", residuals: bool = False
    ) -> Measured:
        """Measurements that `live` makes on the arm, or those of the logs. gap_of: the only joint
        that a log must contain; residuals: True if residuals are required."""
        if self.arm is None:
            return read_measured(self._logs, self.robot.configuration, gap_of=gap_of,
                                 robot=self.robot, residuals=residuals)  # fmt: skip
        return live(self.arm)

    def busy(self, text: str) -> AbstractContextManager[object]:
        """Context that shows a text while the block runs, which takes some time."""
        return self._console.status(text)

    def conclude(self, step: str, outcome: Outcome, recordings: str = "") -> bool:
        """Print and write a result, archive its recordings, named like the step by default, as
        evidence, and draw its plots. True if all results are good."""
        joints = self.robot.configuration.joint_names
        # The result for a payload has no column of joint names.
        aligned = outcome.lines[0].joint in joints
        print_outcome(self._console, outcome, max(map(len, joints)) if aligned else 0)
        if not self._dry and (outcome.entries or outcome.payloads):
            self._write(step, outcome)
        self.missed += [line.joint for line in outcome.lines if not line.good]
        if self.arm is not None and not outcome.unfinished:
            self.arm.conclude(recordings or step, now())
        if outcome.draw is not None and not self._dry:
            self._draw(outcome.draw)
        return all(line.good for line in outcome.lines)

    def _write(self, step: str, outcome: Outcome) -> None:
        """Merge into the file as it is now: another command may have written it since."""
        path = self.robot.folder / self.robot.configuration.identified
        serials = {} if self.arm is None else self.arm.serials()
        with locked(path):
            there = load_robot(self.robot.path, walls=False).identified
            robot = replace(self.robot, identified=there)
            if outcome.payloads:
                found = merged_payloads(robot, outcome.payloads)
            else:
                found = merged(robot, step, outcome.entries, serials)
            refuse_unreadable(robot, found)
            write_identified(path, found)
        self.robot = replace(robot, identified=found)
        self._written += [*outcome.entries, *outcome.payloads]

    def _draw(self, draw: Callable[[Path], list[Path]]) -> None:
        try:
            for picture in draw(self._folder):
                self.show(f"plot: {picture}")
        except OSError as error:
            self.show(f"no plot: {error}")

    def show(self, text: str) -> None:
        """Show a text to the user."""
        unwrapped = not self._console.is_terminal  # in a file, each sentence is one line
        self._console.print(text, markup=False, highlight=False, soft_wrap=unwrapped)


def open_identification(
    config: Path | None, logs: tuple[Path, ...], socket: Path | None, *, dry: bool, yes: bool
) -> Identification:
    """Identification from logs, or on the arm of the running daemon. Its fault is reset, and it is
    enabled and moved, only if the user agrees or `yes` is given. Raises ContactdError."""
    console = on_stdout()
    if logs:
        if config is None:
            raise ConfigurationError("--log needs --config: the folder for the results")
        robot = load_robot(config)
        return Identification(robot, console, logs=logs, dry=dry)
    if threading.current_thread() is threading.main_thread():
        stop_once()
    session = open_session(socket, console, lambda off: yes or may_move(robot, off=off))
    with ExitStack() as refused:
        refused.callback(session.close)
        status = session.client.ask_status()
        if status.mode == Mode.FAULTED and (yes or may_reset(status.cause)):
            session.reset()
            session.say(f"the fault is reset: {status.cause}")
        session.take_up_changes()
        robot = load_robot(from_here(Path(session.client.ask_status().configuration)))
        if config is not None and load_robot(config).path.resolve() != robot.path.resolve():
            raise ConfigurationError(f"the running daemon uses {robot.path}, not {config}")
        session.folder = robot.folder / "identify"
        arm = LiveArm(robot, session, console)
        refused.pop_all()
    return Identification(robot, console, arm=arm, dry=dry)


def stop_once() -> None:
    """Turn the first SIGINT, SIGTERM or SIGHUP into a KeyboardInterrupt and ignore all later ones,
    so that bringing the arm to rest is not interrupted. Main thread only."""
    stopped = False

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal stopped
        if not stopped:
            stopped = True
            raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, stop)


def may_move(robot: Robot, *, off: bool) -> bool:
    """Ask at the terminal whether the arm may move, after enabling the drives if they are `off`.
    Raises ControlError without a terminal."""
    if not sys.stdin.isatty():
        state = "off and must be enabled" if off else "on and the arm will move"
        raise ControlError(f"the drives are {state} for this step: without a terminal pass --yes")
    c = robot.configuration
    ends = {end: [j.name for j in c.joints if j.end == end] for end in ("hold", "brake", "limp")}
    later = "; ".join(f"{end}: {', '.join(names)}" for end, names in ends.items() if names)
    text = (
        "The drives are off. This step enables them and moves the arm; at the end the arm returns "
        f"to its present pose and its joints end as configured ({later})."
    )
    text = text if off else "The arm is enabled, and this step moves it."
    say(f"{text} Keep people out of its reach, and the emergency stop within yours.")
    return confirmed("Enable the drives?" if off else "Move the arm?")


def may_reset(cause: str) -> bool:
    """Ask at the terminal whether to reset a fault; False without a terminal."""
    if not sys.stdin.isatty():
        return False
    say(f"The arm is faulted: {cause}. Inspect it first; after a reset its drives are off.")
    return confirmed("Reset the fault?")


def show_overview(config: Path | None, socket: Path | None) -> bool:
    """Print the identification state of the robot in `config`, or of the running daemon's robot;
    True if nothing is missing. Raises ContactdError."""
    if config is None:
        with Client(socket) as client:
            config = from_here(Path(client.ask_status().configuration))
    seen = overview(load_robot(config), datetime.now(UTC))
    print_overview(on_stdout(), seen)
    return not seen.following


def from_here(path: Path) -> Path:
    """Path as a user would type it: relative below the working directory, else absolute. In the
    root directory it stays absolute, as a relative one could be mistaken for another path."""
    here = Path.cwd()
    inside = path.is_relative_to(here) and here != Path(here.root)
    return path.relative_to(here) if inside else path
