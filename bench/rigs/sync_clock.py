"""Simulated arm on a bus of the same process, the daemon's frames its clock: deterministic."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, Protocol

import can

from daemon.config.load import Robot
from drivers.can.wire import Frame, Wire, frame_of
from drivers.makes import LANGUAGES
from simulator.arm import SYNC, SimulatedArm


class Receiver(Protocol):
    """The arm's end of a bus, as far as it is needed."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, like `BusABC.recv`."""


PhaseOf = Callable[[can.Message], float | None]
#: Share of a period after which setpoints go out that act at once.
SETPOINT_PHASE: Final = 0.4
#: Channel in the frames of a guardian, whose setpoints begin no period.
GUARDIAN: Final = "guardian"


def at_sync(message: can.Message) -> float | None:
    """Phase of a frame to CANopen drives, which take a setpoint at the next SYNC."""
    return 0.0 if message.arbitration_id == SYNC and not message.is_extended_id else None


def at_request(robot: Robot) -> PhaseOf:
    """Phase of frames to motors of other makes: a period begins with the first's request, which the
    daemon sends."""
    drives = robot.configuration.joint_drives
    language = LANGUAGES[type(drives[0].profile)](drives)
    setpoint = language.setpoints[0][0]

    def phase_of(message: can.Message) -> float | None:
        frame = frame_of(message)
        if message.channel == GUARDIAN:
            return None
        return 0.0 if language.begins(frame) else SETPOINT_PHASE if frame[0] == setpoint else None

    return phase_of


class Lockstep:
    """Clock of the arm, which the daemon's frames alone move: `phase_of` a frame is when it is sent
    in a period, 0 for the first of one, None for a frame without a time.

    The owner of the other end calls `pump` after sending; the answers are then in its queue. For
    the SDO part of a boot-up, `serving` answers from a thread, while the plant stands still.
    """

    def __init__(self, arm: SimulatedArm, bus: Receiver, phase_of: PhaseOf = at_sync) -> None:
        self.arm, self._bus, self._phase_of = arm, bus, phase_of
        self.syncs = 0
        """Periods begun so far."""
        self._phase = 0.0
        self._serving, self._emptied = False, 0  # how often no frame was left
        self._alone = threading.Lock()

    def pump(self, timeout: float = 0.0) -> int:
        """Handle all queued frames; waits up to `timeout` s for the first. How many there were."""
        count = 0
        message = self._bus.recv(timeout)
        while message is not None:
            count += 1
            self._take(message)
            message = self._bus.recv(0.0)
        self._emptied += 1
        return count

    def catch_up(self) -> None:
        """While serving: wait until all that was sent before is handled, however late the thread
        gets its turn."""
        # The first time may be of a look from before that was sent.
        emptied = self._emptied + 2
        while self._serving and self._emptied < emptied:
            time.sleep(2e-4)

    def _take(self, message: can.Message) -> None:
        with self._alone:
            period_s, phase = self.arm.description.period_s, self._phase_of(message)
            if phase == 0.0:
                self.syncs += 1
            if phase is not None:
                later = phase - self._phase if phase else 1.0 - self._phase
                self.arm.advance(self.arm.now + max(later, 0.0) * period_s)
                self._phase = phase
            self.arm.receive(message)

    def let_pass(self, seconds: float) -> None:
        """While serving: let so much time pass for the arm, and no less for its clients, so that
        none of them misses a heartbeat."""
        time.sleep(seconds)
        with self._alone:
            self.arm.advance(self.arm.now + seconds)

    @contextmanager
    def serving(self) -> Iterator[None]:
        """Pump in a thread for as long as the block lasts; do not send a SYNC inside."""
        self._serving = True
        thread = threading.Thread(target=self._serve, name="simulated arm", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._serving = False
            thread.join()
            self.pump()

    def _serve(self) -> None:
        while self._serving:
            self.pump(0.002)
            # A drive that takes its time for an SDO gets that, and no more.
            while (t := self.arm.answers_at()) is not None:
                self.let_pass(max(t - self.arm.now, 0.0) + 2e-3)


class AnsweredWire:
    """The daemon's wire to an arm in lockstep, whose time is the arm's, not a clock's: while it
    serves, what it has to answer is here before a wait is over."""

    def __init__(self, wire: Wire, lockstep: Lockstep) -> None:
        self.send = wire.send
        self._wire, self._lockstep = wire, lockstep

    def receive(self, timeout: float) -> Frame | None:
        """The next frame, as `Wire.receive`."""
        frame = self._wire.receive(timeout)
        if frame is None and timeout > 0.0:
            self._lockstep.catch_up()
            frame = self._wire.receive(0.0)
        return frame
