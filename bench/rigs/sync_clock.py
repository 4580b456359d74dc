"""Simulated arm on a bus of the same process, with the SYNC as its clock: deterministic."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

import can

from simulator.arm import SYNC, SimulatedArm


class Receiver(Protocol):
    """The arm's end of a bus, as far as it is needed."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, like `BusABC.recv`."""


class Lockstep:
    """Clock of the arm: every frame with the identifier `clock`, a SYNC, moves it on by one period;
    nothing else moves it.

    The owner of the other end calls `pump` after sending; the answers are then in its queue. For
    the SDO part of a boot-up, `serving` answers from a thread, while the plant stands still.
    """

    def __init__(self, arm: SimulatedArm, bus: Receiver, clock: int = SYNC) -> None:
        self.arm, self._bus, self._clock = arm, bus, clock
        self.syncs = 0
        """SYNCs seen since the beginning."""
        self._serving = False
        self._alone = threading.Lock()

    def pump(self, timeout: float = 0.0) -> int:
        """Handle all queued frames; waits up to `timeout` s for the first. How many there were."""
        count = 0
        message = self._bus.recv(timeout)
        while message is not None:
            count += 1
            self._take(message)
            message = self._bus.recv(0.0)
        return count

    def _take(self, message: can.Message) -> None:
        with self._alone:
            if message.arbitration_id == self._clock and not message.is_extended_id:
                self.syncs += 1
                self.arm.advance(self.arm.now + self.arm.description.period_s)
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
            self.pump(0.02)
            # A drive that takes its time for an SDO gets that, and no more.
            while (t := self.arm.answers_at()) is not None:
                self.let_pass(max(t - self.arm.now, 0.0) + 2e-3)
