"""Steps of the identification for a person at a terminal: `contactd identify`."""

import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

import click
from rich.console import Console

from daemon.clients.client import Client
from daemon.commands.console import on_stdout
from daemon.commands.questions import choice, sure
from daemon.commands.sentences import say
from daemon.config.evidence import outdated
from daemon.config.identified import Identified, write_identified
from daemon.config.load import Robot, load_robot, refuse_unreadable
from daemon.config.schema import AnyStep
from daemon.identify.bodies import masses_step, merged_payloads, payload_step, refuse_name
from daemon.identify.encoders import encoders_step
from daemon.identify.levels import thresholds_step
from daemon.identify.live_arm import LiveArm, open_session
from daemon.identify.live_strokes import UnobservableError
from daemon.identify.overview import overview
from daemon.identify.plots import plot_friction, plot_gap
from daemon.identify.session import ApartError, stop_once
from daemon.identify.show import print_outcome, print_overview
from daemon.identify.source import Recorded, Source
from daemon.identify.steps import (
    Line,
    Outcome,
    friction_step,
    gap_step,
    merged,
    wiring_goes_on,
    wiring_step,
)
from daemon.identify.zero import not_possible, zero_step
from daemon.modes.table import Mode
from errors import ConfigurationError, ControlError
from estimator.identification.gap_result import GapVerdict
from estimator.identification.thresholds import LevelVerdict

PLUS = (
    "Where the right thumb lies along a joint's axis, as the URDF has it, the fingers point to +."
)


class Identification:
    """Steps on one robot; each prints, writes good results, and returns True if all were good."""

    def __init__(self, robot: Robot, source: Source, console: Console, *, dry: bool) -> None:
        self._robot, self._source, self._console, self._dry = robot, source, console, dry
        self._folder = robot.folder / "identify"
        self._written: list[str] = []
        self._missed: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """List what was written, also if a step was stopped, and close the source."""
        if kind is click.Abort:
            self._tell("")  # Ctrl-C at a question leaves its line open
        path = self._robot.folder / self._robot.configuration.identified
        if self._written:
            self._tell(f"written to {path}: {', '.join(self._written)}")
            if self._missed:
                self._tell(f"not written: {', '.join(self._missed)}")
        else:
            self._tell(f"nothing written to {path}")
        well = kind is None or issubclass(kind, SystemExit)
        self._source.close(well=well, written=bool(self._written))

    def joints(self, named: tuple[str, ...]) -> list[str]:
        """Named joints, or all. Raises ConfigurationError for a joint that does not exist."""
        known = self._robot.configuration.joint_names
        for name in named:
            if name not in known:
                raise ConfigurationError(f"no joint {name}; there are: {', '.join(known)}")
        return list(named) or known

    def zero(self, stated: dict[str, float]) -> bool:
        """Find sign and zero of the link encoders of joints that stand at `stated` [rad]."""
        names = self.joints(tuple(stated))
        if nowhere := not_possible(self._robot, stated):
            raise ConfigurationError("; ".join(nowhere))
        outcomes = []
        self._tell(PLUS)
        for name in names:
            seen, upward = self._source.pushed(name, partial(self._which_way, name))
            outcome = zero_step(self._robot, name, seen, stated[name], upward=upward, date=now())
            outcomes.append(self._conclude("zero", "zero", outcome))
        return all(outcomes)

    def _which_way(self, name: str) -> bool:
        self._tell(f"{name} stands. Push its link a little, either way, and hold it there.")
        return choice("Which way did it go", ["+", "-"]) == "+"

    def wiring(self, named: tuple[str, ...]) -> bool:
        """Check signs and scales, joint by joint."""
        outcomes, left = list[bool](), self.joints(named)
        wrong: dict[str, str] = {}
        while left:
            name = left[0]
            try:
                measured = self._source.wiring(name, wiring_goes_on(left, passed=any(outcomes)))
            except ApartError as error:
                new = {joint: why for joint, why in error.why.items() if joint not in wrong}
                left = [joint for joint in left if joint not in new]
                self._go_on_without(wrong, new, left, error)
                wrong |= new
                outcomes.append(False)
            else:
                outcome = wiring_step(self._robot, {name: measured}, now())
                outcomes.append(self._conclude("wiring", f"wiring-{name}", outcome))
                left = left[1:]
        self._tell_void_wiring()
        return all(outcomes)

    def _tell_void_wiring(self) -> None:
        """Say whose wiring passed before something was changed, and has to pass once more."""
        robot = self._robot
        void = outdated("wiring", robot.identified, robot.configuration, robot.urdf)
        if names := [name for name in void if name not in self._missed]:
            self._tell(
                f"{', '.join(names)} passed before drives, wiring or torque constants were "
                f"changed, and have to once more: `contactd identify wiring {' '.join(names)}`"
            )

    def _go_on_without(
        self, wrong: Mapping[str, str], new: Mapping[str, str], left: list[str], error: ApartError
    ) -> None:
        """Tell the joints that came apart, and have the others checked. Raises `error` where the
        person enabled the drives, and ControlError where those that are wrong keep the others
        from being checked."""
        if new:
            lines = [Line(joint, "wrong", good=False, reason=why) for joint, why in new.items()]
            self._conclude("wiring", "", Outcome(lines, {}), more=True)
        if not self._source.recover(on=bool(new and left)):
            raise error
        if not new:
            raise ControlError(
                f"{', '.join(wrong)} comes apart whenever the drives are enabled, which are off "
                f"now: correct it, then check the others ({', '.join(left)})"
            )

    def gap(self, named: tuple[str, ...], *, by_hand: bool = False) -> bool:
        """Identify half-gaps, joint by joint, without a hand or with one."""
        outcomes = []
        step = "gap" if by_hand else "strokes"
        for name in self.joints(named):
            try:
                measured = self._source.gap(name, by_hand=by_hand)
            except UnobservableError as error:
                line = Line(name, "by hand", good=False, reason=str(error))
                outcomes.append(self._conclude("gap", f"{step}-{name}", Outcome([line], {})))
                continue
            with self._console.status(f"fitting the gap of {name} to it"):
                outcome = gap_step(self._robot, measured, [name], now(), by_hand=by_hand)
            i = measured.log.joints.index(name)
            picture = self._folder / f"gap-{name}.png"
            found = outcome.gaps[0]
            # Too few crossings are a beginning: the next ones are added to them.
            more = by_hand and found.verdict is GapVerdict.FEW
            outcomes.append(self._conclude("gap", f"{step}-{name}", outcome, more=more))
            self._draw(partial(plot_gap, measured.log, i, found.half_gap, picture))
        return all(outcomes)

    def friction(self, seconds: float, shortest_s: float) -> bool:
        """Identify friction and rotor inertia of all joints, from no less than `shortest_s`."""
        measured = self._source.friction(seconds)
        with self._console.status("fitting friction and rotors to it"):
            outcome = friction_step(self._robot, measured, now(), shortest_s)
        good = self._conclude("friction", "friction", outcome)
        if outcome.shown is not None:
            self._draw(partial(plot_friction, measured.log, outcome.shown, self._folder))
        return good

    def masses(self, seconds: float, shortest_s: float) -> bool:
        """Identify what the joints move, from no less than `shortest_s`."""
        measured = self._source.masses(seconds)
        with self._console.status("fitting masses to it"):
            outcome = masses_step(self._robot, measured, now(), shortest_s)
        return self._conclude("masses", "masses", outcome)

    def payload(self, name: str, seconds: float) -> bool:
        """Identify the load in the hand, for `contactctl payload NAME`."""
        refuse_name(name)
        outcome = payload_step(self._robot, self._source.payload(name, seconds), name, now())
        print_outcome(self._console, outcome, len(name))
        if outcome.payloads and not self._dry:
            self._write(merged_payloads(self._robot, outcome.payloads))
            self._written.append(name)
        self._source.conclude("payload", now())
        return bool(outcome.payloads)

    def encoders(self, named: tuple[str, ...], seconds: float) -> bool:
        """Find what link encoders err with each turn."""
        joints = self.joints(named)
        measured = self._source.encoders(seconds)
        with self._console.status("fitting errors of encoders to it"):
            outcome = encoders_step(self._robot, measured, joints, now())
        return self._conclude("encoders", "encoders", outcome)

    def thresholds(self, seconds: float, per_hour: float, *, it_was_me: bool = False) -> bool:
        """Identify two levels per joint; it_was_me: every touch that is found was the person's."""
        measured = self._source.thresholds(seconds)
        with self._console.status("finding levels in it"):
            outcome = thresholds_step(self._robot, measured, per_hour, now(), it_was_me=it_was_me)
        # Asked whether it was the person, what was measured waits for the answer.
        asked = any(line.verdict == LevelVerdict.UNLESS_YOU for line in outcome.lines)
        return self._conclude("thresholds", "thresholds", outcome, more=asked)

    def _conclude(
        self,
        step: AnyStep,
        name: str,
        outcome: Outcome,
        *,
        more: bool = False,
    ) -> bool:
        width = max(len(name) for name in self._robot.configuration.joint_names)
        print_outcome(self._console, outcome, width)
        if outcome.entries and not self._dry:
            found = merged(self._robot, step, outcome.entries, self._source.serials())
            self._write(found)
            self._written += outcome.entries
        self._missed += [line.joint for line in outcome.lines if not line.good]
        if not more:
            self._source.conclude(name, now())
        return all(line.good for line in outcome.lines)

    def _write(self, found: Identified) -> None:
        refuse_unreadable(self._robot, found)
        write_identified(self._robot.folder / self._robot.configuration.identified, found)
        self._robot = replace(self._robot, identified=found)

    def _draw(self, draw: Callable[[], list[Path]]) -> None:
        if self._dry:
            return
        try:
            for picture in draw():
                self._tell(f"picture: {picture}")
        except OSError as error:
            self._tell(f"no picture: {error}")

    def _tell(self, text: str) -> None:
        whole = not self._console.is_terminal  # a file gets a sentence in one line
        self._console.print(text, markup=False, highlight=False, soft_wrap=whole)


def identification(
    config: Path | None, logs: tuple[Path, ...], socket: Path | None, *, dry: bool, yes: bool
) -> Identification:
    """Identification on logs, or on the arm of the running daemon, whose fault is reset and whose
    drives are enabled for it if the person, unless `yes`, says so. Raises ContactdError."""
    console = on_stdout()
    if logs:
        if config is None:
            raise ConfigurationError("--log needs --config: the folder that results go to")
        robot = load_robot(config)
        return Identification(robot, Recorded(logs, robot.configuration), console, dry=dry)
    if threading.current_thread() is threading.main_thread():
        stop_once()
    session = open_session(socket, console, lambda: yes or may_enable(robot))
    with ExitStack() as refused:
        refused.callback(session.close)
        status = session.client.ask_status()
        if status.mode == Mode.FAULTED and (yes or may_reset(status.cause)):
            session.reset()
            session.say(f"the fault is reset: {status.cause}")
        session.take_up_changes()
        robot = load_robot(from_here(Path(session.client.ask_status().configuration)))
        if config is not None and load_robot(config).path.resolve() != robot.path.resolve():
            raise ConfigurationError(f"the running daemon is that of {robot.path}, not of {config}")
        session.folder = robot.folder / "identify"
        arm = LiveArm(robot, session, console)
        refused.pop_all()
    return Identification(robot, arm, console, dry=dry)


def may_enable(robot: Robot) -> bool:
    """Ask the person to have the drives enabled; they are not where nobody can be asked."""
    if not sys.stdin.isatty():
        raise ControlError("the drives are off, and nobody can be asked here: --yes enables them")
    c = robot.configuration
    ends = {end: [j.name for j in c.joints if j.end == end] for end in ("hold", "brake", "limp")}
    later = "; ".join(f"{end}: {', '.join(names)}" for end, names in ends.items() if names)
    say(
        "The drives are off. They are enabled for this, the arm moves, and at the end it goes back "
        f"to where it stands and its joints end as configured ({later}). Nobody may be in reach of "
        "it, and the emergency stop must be in yours."
    )
    return sure("Enable the drives?")


def may_reset(cause: str) -> bool:
    """Ask the person to have a fault reset; it is not where nobody can be asked."""
    if not sys.stdin.isatty():
        return False
    say(f"The arm is faulted: {cause}. Look at it first; after a reset its drives are off.")
    return sure("Reset the fault?")


def show_overview(config: Path | None, socket: Path | None) -> bool:
    """Print what is known of the robot in `config`, or of the running daemon's; True if nothing is
    missing. Raises ContactdError."""
    if config is None:
        with Client(socket) as client:
            config = from_here(Path(client.ask_status().configuration))
    seen = overview(load_robot(config), datetime.now(UTC))
    print_overview(on_stdout(), seen)
    return not seen.following


def from_here(path: Path) -> Path:
    """Path as a person would type it here: relative below the working directory, else absolute.

    It stays absolute in the root directory, too, where a relative one would look like another.
    """
    here = Path.cwd()
    inside = path.is_relative_to(here) and here != Path(here.root)
    return path.relative_to(here) if inside else path


def now() -> str:
    """Time now as text: UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")
