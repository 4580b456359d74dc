"""Session with the running daemon: motions of identification, recorded as they happen.

What is measured goes into recordings like those of `contactctl record`: a step that was stopped
goes on with what it has, and live steps share all code behind with `--log`. Each step says
something else of a joint that is touched meanwhile.
"""

import itertools
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

import numpy as np

from arrays import Matrix
from daemon.clients import recorder
from daemon.clients.client import Client
from daemon.config.schema import Configuration
from daemon.identify.measured import configuration_of
from daemon.modes.table import Mode
from daemon.protocol.messages import Notice, State, Status
from errors import ContactdError, ControlError, LogError, UnreachableError

_SETTLE_S = 6.0
# What may follow a trajectory of ours; anything else ended it.
_OURS = frozenset({Mode.HOLDING.value, Mode.TRACKING.value})


Told = Callable[[Notice], str]
"""Of a contact; empty where there is nothing to say."""


def stop_once() -> None:
    """Let the first Ctrl-C, SIGTERM or closed terminal be a KeyboardInterrupt, and ignore what
    follows: bringing the arm to rest must not itself be stopped. For the main thread."""
    stopped = False

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal stopped
        if not stopped:
            stopped = True
            raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, stop)


class InterruptedStepError(ContactdError):
    """A step was stopped; what was measured is kept."""


def followed(
    states: Iterable[State], each: Callable[[State], bool], felt: Callable[[Notice], None]
) -> str:
    """Until the trajectory has come to its end, or `each`, which sees all of it, has enough. The
    answer says what else ended it; `felt` is told of contacts as they come."""
    begun = False
    for state in states:
        for event in state.notices:
            if event.kind == "contact":
                felt(event)
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
    """The daemon's door, and the folder for recordings; `say` tells the person."""

    socket: Path | None
    folder: Path
    say: Callable[[str], None]
    client: Client = field(init=False)

    def __post_init__(self) -> None:
        self.client = Client(self.socket)

    def configuration(self) -> Configuration:
        """That of the daemon as it runs, whatever its files say by now."""
        with Client(self.socket) as reader:
            return configuration_of(reader.subscribe()[0])

    def hold(self) -> Status:
        """Wait until the arm holds, disarmed. Raises ControlError where it does not: enabling is
        left to the person."""
        status = self.client.ask_status()
        if status.mode == Mode.OFF:
            raise ControlError("the drives are off: look at the arm, then `contactctl enable`")
        if status.mode == Mode.FAULTED:
            raise ControlError(f"a fault is latched: {status.cause}")
        if status.armed:
            self.client.demand("disarm")
        if status.mode == Mode.TRACKING:
            self.client.demand("pause")
        deadline = time.monotonic() + _SETTLE_S
        while (status := self.client.ask_status()).mode != Mode.HOLDING:
            if time.monotonic() > deadline:
                raise ControlError(f"the arm does not hold: {status.mode}, {status.cause}")
            time.sleep(0.05)
        return status

    def parts(self, step: str) -> list[Path]:
        """Recordings of a step that is not concluded, in the order of their making."""
        return sorted(self.folder.glob(f"{step}.part*.mcap"))

    def conclude(self, step: str, stamp: str) -> None:
        """The results are written: the recordings are evidence now."""
        for number, path in enumerate(self.parts(step), start=1):
            path.rename(self.folder / f"{step}-{stamp.replace(':', '')}-{number}.mcap")

    def run(
        self,
        step: str,
        path: Matrix,
        period_s: float,
        each: Callable[[State], bool],
        *,
        of_contact: Told,
        motors_only: bool = False,
        to_go_on: str = "What was measured is kept: the same command goes on from there",
    ) -> None:
        """Run link positions (N, n) and record them; `each` sees every State of it and may end it,
        and what `of_contact` has to say of a contact is told at once.

        Raises InterruptedStepError for Ctrl-C and for whatever else ends it, with what `to_go_on`
        says; ControlError and TrajectoryError where it cannot begin, LogError where it cannot be
        recorded. The arm holds afterwards if it still can.
        """

        def felt(event: Notice) -> None:
            if text := of_contact(event):
                self.say(text)

        status = self.hold()
        times = (period_s * np.arange(len(path))).tolist()
        self.client.load_trajectory(
            status.joints, times, path.tolist(), name=f"identify {step}", motors_only=motors_only
        )
        names = (f"{step}.part{number:02}.mcap" for number in itertools.count(1))
        parts = (self.folder / name for name in names)
        with self._recording(next(part for part in parts if not part.exists())):
            try:
                with Client(self.socket) as reader:
                    # Before the start, so that no State of it is missed.
                    _, states = reader.subscribe()
                    reply = self.client.start_loaded()
                    if not reply.ok:
                        raise ControlError(reply.refusal)
                    ended = followed(states, each, felt)
            except KeyboardInterrupt:
                ended = "stopped by you"
            except UnreachableError as error:
                ended = str(error)
            with suppress(ContactdError):
                mode = self.hold().mode
                ended = ended and f"{ended}; the arm is {mode}"
        if ended:
            raise InterruptedStepError(f"{ended}. {to_go_on}")

    @contextmanager
    def _recording(self, path: Path) -> Iterator[None]:
        """Record beside what the block does; not at all if it could not begin."""
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise LogError(f"cannot record in {self.folder}: {error.strerror}") from error
        ended = threading.Event()
        failures: list[ContactdError] = []

        def work() -> None:
            try:
                made = recorder.record(lambda: Client(self.socket), path, stop=ended.is_set)
                if made.lost:
                    self.say(f"{made.lost} ticks were not recorded: this machine is too busy")
            except ContactdError as error:
                failures.append(error)

        thread = threading.Thread(target=work, name="recorder")
        thread.start()
        deadline = time.monotonic() + 2.0
        while not path.exists() and thread.is_alive() and time.monotonic() < deadline:
            time.sleep(0.01)
        if failures:
            raise failures[0]
        refused = False
        try:
            yield
        except ControlError:
            refused = True
            raise
        finally:
            ended.set()
            thread.join()
            if refused:
                path.unlink(missing_ok=True)
        if failures:
            raise failures[0]


def left_out(event: Notice) -> str:
    """Friction and thresholds learn nothing from what lies around a touch."""
    return f"{event.text}: if that was you, hands off; it is discarded"


def spoils_wiring_of(joint: str) -> Told:
    """The wiring is judged by all of so short a motion."""

    def told(event: Notice) -> str:
        return f"{event.text}: if that was you, hands off, and check the wiring of {joint} again"

    return told


def alone(joint: str) -> Told:
    """A hand is to push this joint, of which there is nothing to say, and no other."""

    def told(event: Notice) -> str:
        contact = event.contact
        if contact is None or contact.joint == joint:
            return ""
        return f"{contact.joint} feels {contact.torque:+.2f} Nm: move {joint} alone"

    return told
