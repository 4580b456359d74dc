"""Session with the running daemon: runs and records the motions of the identification.

Measurements are stored in recordings like those of `contactctl record`, so that an interrupted step
can continue, and live steps share their evaluation with `--log`. Each step has its own warning for
a joint that is touched meanwhile.
"""

import itertools
import math
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from common.arrays import Matrix, Vector
from common.errors import ContactdError, ControlError, UnreachableError
from daemon.config.schema import Configuration
from daemon.faults.conditions import Condition
from daemon.modes.table import Mode
from daemon.protocol.replies import Reply, Status
from daemon.protocol.state import Notice, State
from programs.clients.client import Client
from programs.clients.reload import reload
from programs.clients.waiting import asked_until, reset
from programs.identify.contact_warnings import ContactWarning
from programs.identify.measured import configuration_of
from programs.identify.stream_readers import collecting, recording

_SETTLE_S = 6.0
# The daemon halts an attended motion after 2 s without a request.
_ATTENDS_EVERY_S = 0.5
# Window and largest displacement of a joint at rest [s, rad].
_STILL_S, _STILL = 0.3, 0.002
_RESTS = frozenset({Mode.OFF, Mode.HOLDING, Mode.FAULTED})  # left only by a command or contact
# Modes while our trajectory runs and after its end; any other mode means it was interrupted.
_OURS = frozenset({Mode.HOLDING.value, Mode.TRACKING.value})


class InterruptedStepError(ContactdError):
    """Error of a step that was interrupted; its measurements are kept."""


def distrust(status: Status) -> str:
    """Reason why link positions are not trusted, so that only motors may be moved; empty if they
    are trusted."""
    checks = (one for one in status.checks if one.name == "identification" and not one.passed)
    return next((check.text for check in checks), "")


def followed(
    states: Iterable[State], each: Callable[[State], bool], on_contact: Callable[[Notice], None]
) -> str:
    """Follow the trajectory to its end, or until `each`, called with each of its States, returns
    True. Returns why it ended otherwise, or empty; `on_contact` is called with each contact."""
    begun = False
    for state in states:
        for event in state.notices:
            if event.kind == "contact":
                on_contact(event)
        tracking = state.mode == Mode.TRACKING
        begun = begun or tracking
        if state.mode not in _OURS or (begun and not tracking):
            over = state.mode == Mode.HOLDING and state.cause.endswith("came to its end")
            return "" if over else f"the arm is {state.mode}: {state.cause}"
        if tracking and each(state):
            return ""
    return "the daemon ended"


@dataclass(slots=True)
class Session:
    """Connection to the daemon, and the folder for recordings; `say` shows a text to the user."""

    socket: Path | None
    folder: Path
    say: Callable[[str], None]
    may_move: Callable[[bool], bool] = lambda off: False
    """Asks the user; argument `off`: the drives are off and would be enabled."""
    client: Client = field(init=False)
    here: Vector | None = None
    """Pose (n,) [rad] in which this session enabled the arm; None if another client did."""
    _held: bool = False
    _runs: bool = False  # a motion of this session is running

    def __post_init__(self) -> None:
        self.client = Client(self.socket)

    def close(self) -> None:
        """Close the connection."""
        self.client.close()

    def reload(self) -> None:
        """Make a daemon in mode off reload its files, and reconnect. Raises ContactdError."""
        self.client.close()
        try:
            reload(self.socket)
        finally:
            self.client = Client(self.socket)

    def take_up_changes(self) -> None:
        """Reload if the daemon is off and its files were changed since it read them."""
        status = self.client.ask_status()
        if status.mode == Mode.OFF and status.changed:
            self.reload()

    def configuration(self) -> Configuration:
        """Configuration that the daemon runs with, even if its files have changed since."""
        with Client(self.socket) as reader:
            return configuration_of(reader.subscribe()[0])

    def hold(self, *, motors_only: bool = False) -> Status:
        """Bring the arm to hold, disarmed; the first time only if the user agrees that it moves.
        Raises ControlError if it does not hold, if it runs another client's motion, or, unless
        `motors_only`, if the drives are off and link positions are not trusted."""
        status = self.client.ask_status()
        if status.mode == Mode.OFF:
            if self._held:
                raise ControlError(f"the drives were switched off: {status.cause}")
            if not motors_only and (why := distrust(status)):
                raise ControlError(f"the drives stay off: {why}")
            if not self.may_move(True):
                raise ControlError("the drives are off: check the arm, then `contactctl enable`")
            self.here = np.array(status.link_position)
            self._enable()
        if status.mode == Mode.FAULTED:
            raise ControlError(f"a fault is latched: {status.cause}; `contactctl reset`")
        if status.mode == Mode.TRACKING:
            if not self._runs:
                what = status.trajectory.name
                raise ControlError(f"the arm runs {what}, started elsewhere: `contactctl pause`")
            self.client.demand("pause")
        if not (self._held or self.here is not None or self.may_move(False)):
            raise ControlError("the arm stays as it is: you did not let it move")
        if status.armed:
            self.client.demand("disarm")
        status = asked_until(self.client.ask_status, lambda s: s.mode in _RESTS, _SETTLE_S)
        if status.mode != Mode.HOLDING:
            raise ControlError(f"the arm does not hold: {status.mode}, {status.cause}")
        self._held = True
        return status

    def _enable(self) -> None:
        reply = self.client.request("enable")
        if not reply.ok and Condition.APART in reply.refusal:
            # The links may have been moved by hand. A reload clears this state; if motor and link
            # really disagree, the daemon detects it again as soon as something moves.
            self.reload()
            reply = self.client.request("enable")
        if not reply.ok:
            raise ControlError(reply.refusal)
        self._settle()

    def _settle(self) -> None:
        """Wait until no joint moves: links sag when brakes open, until their drives hold them."""
        before = self.client.ask_status()
        patient_until = before.uptime_s + _SETTLE_S
        while (now := self.client.ask_status()).uptime_s < patient_until:
            if now.uptime_s > before.uptime_s + _STILL_S:
                moved = np.abs(np.subtract(now.link_position, before.link_position))
                if now.mode == Mode.FAULTED or float(moved.max()) < _STILL:
                    return
                before = now
            time.sleep(0.02)

    def recover(self) -> None:
        """Recover from a fault that ended this session's motion: reset, reload, and enable again.
        Raises ControlError."""
        self.reset()
        self.reload()
        self.client.demand("enable")
        self._settle()

    def reset(self) -> None:
        """Acknowledge a fault, after which the drives are off. Raises ControlError."""
        if not (reply := reset(self.client, _SETTLE_S)).ok:
            raise ControlError(reply.refusal)
        self._until_off()

    def disable(self) -> None:
        """Switch the drives off, joints as configured. Raises ControlError on timeout."""
        self.client.demand("disable")
        self._until_off()

    def _until_off(self) -> None:
        def off(status: Status) -> bool:
            return status.mode == Mode.OFF and not status.unproved

        if not off(status := asked_until(self.client.ask_status, off, _SETTLE_S)):
            if status.mode == Mode.OFF:
                joints = ", ".join(status.unproved)
                raise ControlError(
                    f"the drives are off; not seen to stand: {joints}: check the arm"
                )
            raise ControlError(f"the drives are not off: {status.mode}, {status.cause}")

    @contextmanager
    def watched(self, settled: Callable[[list[State]], bool]) -> Iterator[list[State]]:
        """Growing list of all States while the block runs, which starts once they are `settled`.
        Raises ControlError if the drives are not, or do not stay, off; UnreachableError."""
        if (status := self.client.ask_status()).mode != Mode.OFF:
            raise ControlError(
                f"the arm is {status.mode}: links may only be pushed while the drives are off "
                "(`contactctl disable`; after a fault `contactctl reset`)"
            )
        with collecting(self._connect, settled) as seen:
            yield seen
            looked: list[State | Status] = [*seen, self.client.ask_status()]  # seen may be late
        if left := next((one for one in looked if one.mode != Mode.OFF), None):
            raise ControlError(
                f"the arm did not stay off: {left.mode}, {left.cause}; after a fault "
                "`contactctl reset`, then repeat the remaining joints: push gently"
            )

    def parts(self, step: str) -> list[Path]:
        """Recordings of a step that is not concluded yet, oldest first."""
        return sorted(self.folder.glob(f"{step}.part*.mcap"))

    def conclude(self, step: str, stamp: str) -> None:
        """Rename the recordings of a step whose results are written, to keep them as evidence."""
        for number, path in enumerate(self.parts(step), start=1):
            path.rename(self.folder / f"{step}-{stamp.replace(':', '')}-{number}.mcap")

    def run(
        self,
        step: str,
        path: Matrix,
        period_s: float,
        each: Callable[[State], bool],
        *,
        warning: ContactWarning,
        motors_only: bool = False,
        touch_ends: bool = False,
        to_go_on: str = "What was measured is kept: the same command goes on from there",
    ) -> None:
        """Run and record a path (N, n) [rad]. `each` is called with each of its States, and ends it
        by returning True; a `warning` about a contact is shown, or with `touch_ends` ends it.

        Raises InterruptedStepError, with the text `to_go_on`, for Ctrl-C and any other
        interruption, ControlError and TrajectoryError if the motion cannot start, LogError if it
        cannot be recorded. The arm then holds if it can, even if this process is killed.
        """
        touched: list[str] = []
        attended_s = -math.inf

        def on_contact(event: Notice) -> None:
            if touch_ends:
                touched.append(warning(event))
            elif text := warning(event):
                self.say(text)

        def seen(state: State) -> bool:
            nonlocal attended_s
            if state.time_s > attended_s + _ATTENDS_EVERY_S:
                self.client.ask_status()
                attended_s = state.time_s
            return each(state) or bool(touched or failures)

        status = self.hold(motors_only=motors_only)
        times = (period_s * np.arange(len(path))).tolist()
        self.client.load_trajectory(
            status.joints, times, path.tolist(), name=f"identify {step}", motors_only=motors_only
        )
        names = (f"{step}.part{number:02}.mcap" for number in itertools.count(1))
        parts = (self.folder / name for name in names)
        free = next(part for part in parts if not part.exists())
        with recording(self._connect, free, self.say) as failures:
            try:
                with Client(self.socket) as reader:
                    # Subscribe before the start, so that no State of the motion is missed.
                    _, states = reader.subscribe()
                    self._runs = True  # set before the reply, as Ctrl-C may come first
                    reply = self.client.start_loaded(attended=True)
                    if not reply.ok:
                        self._runs = False
                        raise ControlError(self._refused(reply))
                    ended = followed(states, seen, on_contact) or "".join(touched[:1])
            except KeyboardInterrupt:
                ended = "stopped by you"
            except UnreachableError as error:
                ended = str(error)
            with suppress(ContactdError):
                mode = self.hold().mode
                ended = ended and f"{ended}; the arm is {mode}"
            self._runs = False
        if ended:
            what = step.replace("-", " of ")
            raise InterruptedStepError(f"{what} did not finish: {ended}. {to_go_on}")

    def _refused(self, reply: Reply) -> str:
        """Reason of a refusal, with the cause of a fault if there is one."""
        status = self.client.ask_status()
        return f"{reply.refusal}: {status.cause}" if status.mode == Mode.FAULTED else reply.refusal

    def _connect(self) -> Client:
        return Client(self.socket)
