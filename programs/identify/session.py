"""Session with the running daemon: motions of identification, recorded as they happen.

What is measured goes into recordings like those of `contactctl record`: a step that was stopped
goes on with what it has, and live steps share all code behind with `--log`. Each step has
its own warning for a joint that is touched meanwhile.
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
# An unattended arm halts after 2 s.
_ATTENDS_EVERY_S = 0.5
# No joint moves that in so long moves less [s, rad].
_STILL_S, _STILL = 0.3, 0.002
_RESTS = frozenset({Mode.OFF, Mode.HOLDING, Mode.FAULTED})  # no other follows by itself
# Modes while our trajectory runs and after its end; any other mode ended it.
_OURS = frozenset({Mode.HOLDING.value, Mode.TRACKING.value})


class InterruptedStepError(ContactdError):
    """Step that was stopped; its measurements are kept."""


def distrust(status: Status) -> str:
    """Reason why links are not trusted, and only motors may be moved; empty if they are."""
    checks = (one for one in status.checks if one.name == "identification" and not one.passed)
    return next((check.text for check in checks), "")


def followed(
    states: Iterable[State], each: Callable[[State], bool], on_contact: Callable[[Notice], None]
) -> str:
    """Follow the trajectory to its end, or until `each`, called with every State of it, is true.

    Returns what else ended it; `on_contact` gets contacts as they come.
    """
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
    """Connection to the daemon, and the folder for recordings; `say` shows the person a text."""

    socket: Path | None
    folder: Path
    say: Callable[[str], None]
    may_move: Callable[[bool], bool] = lambda off: False
    """asks the person; off: the drives are, and are enabled for it"""
    client: Client = field(init=False)
    here: Vector | None = None
    """where the arm stood when this session enabled it (n,) [rad]; None: it was enabled
    elsewhere"""
    _held: bool = False
    _runs: bool = False  # a motion of this session

    def __post_init__(self) -> None:
        self.client = Client(self.socket)

    def close(self) -> None:
        """Close the connection."""
        self.client.close()

    def reload(self) -> None:
        """Have the daemon, which is off, read its files anew. Raises ContactdError."""
        self.client.close()
        try:
            reload(self.socket)
        finally:
            self.client = Client(self.socket)

    def take_up_changes(self) -> None:
        """The same where it is off and its files were changed since it read them."""
        status = self.client.ask_status()
        if status.mode == Mode.OFF and status.changed:
            self.reload()

    def configuration(self) -> Configuration:
        """Configuration that the daemon runs with, whatever its files say by now."""
        with Client(self.socket) as reader:
            return configuration_of(reader.subscribe()[0])

    def hold(self, *, motors_only: bool = False) -> Status:
        """Wait until the arm holds, disarmed; the first time if the person agrees that it moves.
        Raises ControlError where it does not hold, while it runs a motion started elsewhere, and,
        unless `motors_only` are to move, before drives are enabled whose links are not trusted."""
        status = self.client.ask_status()
        if status.mode == Mode.OFF:
            if self._held:
                raise ControlError(f"the drives were switched off: {status.cause}")
            if not motors_only and (why := distrust(status)):
                raise ControlError(f"the drives stay off: {why}")
            if not self.may_move(True):
                raise ControlError("the drives are off: look at the arm, then `contactctl enable`")
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
            # As the links were moved by hand, perhaps: a daemon that begins anew knows nothing of
            # that, and sees it again as soon as something moves.
            self.reload()
            reply = self.client.request("enable")
        if not reply.ok:
            raise ControlError(reply.refusal)
        self._settle()

    def _settle(self) -> None:
        """Wait until no joint moves: links sag where brakes open, until their drives hold them."""
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
        """After a fault, in which this session's own motion has ended: have the daemon begin anew,
        and enable again. Raises ControlError."""
        self.reset()
        self.reload()
        self.client.demand("enable")
        self._settle()

    def reset(self) -> None:
        """Acknowledge such a fault; the drives are off then. Raises ControlError."""
        if not (reply := reset(self.client, _SETTLE_S)).ok:
            raise ControlError(reply.refusal)
        self._until_off()

    def disable(self) -> None:
        """Let the joints end as configured. Raises ControlError where they do not in time."""
        self.client.demand("disable")
        self._until_off()

    def _until_off(self) -> None:
        def off(status: Status) -> bool:
            return status.mode == Mode.OFF and not status.unproved

        if not off(status := asked_until(self.client.ask_status, off, _SETTLE_S)):
            if status.mode == Mode.OFF:
                joints = ", ".join(status.unproved)
                raise ControlError(f"the drives are off; not seen to stand: {joints}: look")
            raise ControlError(f"the drives are not off: {status.mode}, {status.cause}")

    @contextmanager
    def watched(self, settled: Callable[[list[State]], bool]) -> Iterator[list[State]]:
        """Every State while the block runs, which begins once they are `settled`, in a list that
        grows; the drives are off. Raises ControlError where they are not, UnreachableError."""
        if (status := self.client.ask_status()).mode != Mode.OFF:
            raise ControlError(
                f"the arm is {status.mode}: links are pushed while the drives are off "
                "(`contactctl disable`; after a fault `contactctl reset`)"
            )
        with collecting(self._connect, settled) as seen:
            yield seen
            looked: list[State | Status] = [*seen, self.client.ask_status()]  # seen may be late
        if left := next((one for one in looked if one.mode != Mode.OFF), None):
            raise ControlError(
                f"the arm did not stay off: {left.mode}, {left.cause}; after a fault "
                "`contactctl reset`, then the joints that are left: push softly"
            )

    def parts(self, step: str) -> list[Path]:
        """Recordings of a step that is not concluded, oldest first."""
        return sorted(self.folder.glob(f"{step}.part*.mcap"))

    def conclude(self, step: str, stamp: str) -> None:
        """Rename the recordings of a step whose results are written: they are evidence now."""
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
        """Run link positions (N, n) and record them; `each` gets every State of it and may end
        it; a `warning` about a contact is shown at once, or with `touch_ends` ends it.

        Raises InterruptedStepError for Ctrl-C and for whatever else ends it, with the text
        `to_go_on`; ControlError and TrajectoryError where it cannot begin, LogError where it cannot
        be recorded. The arm holds afterwards if it still can, also where this process is killed or
        stopped.
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
                    # Before the start, so that no State of it is missed.
                    _, states = reader.subscribe()
                    self._runs = True  # before the answer comes: Ctrl-C may come first
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
        """Reason of a refusal; for a fault in the moment before, also its cause."""
        status = self.client.ask_status()
        return f"{reply.refusal}: {status.cause}" if status.mode == Mode.FAULTED else reply.refusal

    def _connect(self) -> Client:
        return Client(self.socket)
