"""`contactd identify`: what each step does for a person at a terminal."""

import sys
import threading
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol

from rich.console import Console

from daemon.config.identified import write_identified
from daemon.config.load import Robot, load_robot
from daemon.identify.live import stop_once
from daemon.identify.live_source import LiveArm, open_session
from daemon.identify.logs import Measured, read_measured
from daemon.identify.plots import plot_friction, plot_gap
from daemon.identify.show import print_outcome
from daemon.identify.steps import (
    Outcome,
    friction_step,
    gap_step,
    merged,
    thresholds_step,
    wiring_step,
)
from errors import ConfigurationError
from estimator.identification.gap_answer import GapVerdict


class Source(Protocol):
    """Where measurements come from: a live arm, or logs."""

    def wiring(self, joint: str) -> Measured:
        """One joint's motor, moved both ways through its gap."""

    def gap(self, joint: str) -> Measured:
        """One joint's link, moved by hand while its motor stands."""

    def friction(self, seconds: float) -> Measured:
        """All joints moved without contact."""

    def thresholds(self, seconds: float) -> Measured:
        """Likewise."""

    def conclude(self, step: str, stamp: str) -> None:
        """The results of `step` are printed and written."""

    def serials(self) -> dict[str, int | None]:
        """Of the drives, by joint; empty where they are not known."""

    def close(self) -> None:
        """Hang up."""


class Recorded:
    """Logs, all of them for whichever step."""

    def __init__(self, paths: tuple[Path, ...], joints: list[str]) -> None:
        self._paths, self._joints = paths, joints

    def wiring(self, joint: str) -> Measured:
        return self._read()

    gap = wiring

    def friction(self, seconds: float) -> Measured:
        return self._read()

    thresholds = friction

    def conclude(self, step: str, stamp: str) -> None:
        """A log remains what it is."""

    def serials(self) -> dict[str, int | None]:
        return {}

    def close(self) -> None:
        """Nothing is open."""

    def _read(self) -> Measured:
        return read_measured(self._paths, self._joints)


class Identification:
    """The steps on one robot; each prints, writes what is good, and returns whether all was."""

    def __init__(self, robot: Robot, source: Source, console: Console, *, dry: bool) -> None:
        self._robot, self._source, self._console, self._dry = robot, source, console, dry
        self._folder = robot.folder / "identify"

    def close(self) -> None:
        """Hang up."""
        self._source.close()

    def joints(self, named: tuple[str, ...]) -> list[str]:
        """The named joints, or all. Raises ConfigurationError for one that is not there."""
        known = self._robot.configuration.joint_names
        for name in named:
            if name not in known:
                raise ConfigurationError(f"no joint {name}; there are: {', '.join(known)}")
        return list(named) or known

    def wiring(self, named: tuple[str, ...]) -> bool:
        """Signs and scales, joint by joint."""
        outcomes = []
        for name in self.joints(named):
            outcome = wiring_step(self._robot, {name: self._source.wiring(name)}, now())
            outcomes.append(self._conclude("wiring", f"wiring-{name}", outcome))
        return all(outcomes)

    def gap(self, named: tuple[str, ...]) -> bool:
        """Half-gaps."""
        outcomes = []
        for name in self.joints(named):
            measured = self._source.gap(name)
            outcome = gap_step(self._robot, measured, [name], now())
            i = self._robot.configuration.joint_names.index(name)
            self._folder.mkdir(exist_ok=True)
            picture = self._folder / f"gap-{name}.png"
            plotted = plot_gap(measured.log, i, outcome.gaps[0].half_gap, picture)
            pictures = [plotted] if plotted else []
            # Too few crossings are a beginning: the next ones are added to them.
            more = outcome.gaps[0].verdict is GapVerdict.FEW
            outcomes.append(self._conclude("gap", f"gap-{name}", outcome, pictures, more=more))
        return all(outcomes)

    def friction(self, seconds: float) -> bool:
        """Friction and rotor inertia of all joints."""
        measured = self._source.friction(seconds)
        outcome = friction_step(self._robot, measured, now())
        shown = outcome.shown
        pictures = plot_friction(measured.log, shown, self._folder) if shown else []
        return self._conclude("friction", "friction", outcome, pictures)

    def thresholds(self, seconds: float, per_hour: float) -> bool:
        """Two levels per joint."""
        outcome = thresholds_step(self._robot, self._source.thresholds(seconds), per_hour, now())
        return self._conclude("thresholds", "thresholds", outcome)

    def _conclude(
        self,
        step: str,
        name: str,
        outcome: Outcome,
        pictures: list[Path] | None = None,
        *,
        more: bool = False,
    ) -> bool:
        print_outcome(self._console, outcome, f"{step} of {self._robot.configuration.name}")
        for picture in pictures or []:
            self._tell(f"picture: {picture}")
        if outcome.entries and not self._dry:
            path = self._robot.folder / self._robot.configuration.identified
            found = merged(self._robot, step, outcome.entries, self._source.serials())
            write_identified(path, found)
            self._robot = replace(self._robot, identified=found)
            self._tell(f"written to {path}: {', '.join(outcome.entries)}")
            self._tell("the daemon takes it up when it is started again")
        else:
            self._tell("nothing written")
        if not more:
            self._source.conclude(name, now())
        return all(line.good for line in outcome.lines)

    def _tell(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)


def identification(
    config: Path | None, logs: tuple[Path, ...], socket: Path | None, *, dry: bool
) -> Identification:
    """Of logs, or of the running daemon's arm; raises ContactdError."""
    console = terminal()
    if logs:
        if config is None:
            raise ConfigurationError("--log needs --config: the folder that results go to")
        robot = load_robot(config)
        return Identification(
            robot, Recorded(logs, robot.configuration.joint_names), console, dry=dry
        )
    if threading.current_thread() is threading.main_thread():
        stop_once()
    session = open_session(socket, console)
    robot = load_robot(Path(session.status().configuration))
    if config is not None and load_robot(config).path.resolve() != robot.path.resolve():
        raise ConfigurationError(f"the running daemon is that of {robot.path}, not of {config}")
    session.folder = robot.folder / "identify"
    return Identification(robot, LiveArm(robot, session, console), console, dry=dry)


def terminal() -> Console:
    """Nothing is folded away for a file or a pipe."""
    return Console() if sys.stdout.isatty() else Console(width=120)


def now() -> str:
    """UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")
