"""Simulated arm in real time: over TCP for other processes, or as nodes on a CAN bus."""

import errno
import selectors
import signal
import socket
import threading
import time
from collections.abc import Callable, Sequence
from typing import BinaryIO

import can
import msgspec

from common.errors import BusError
from simulator.arm import SimulatedArm
from simulator.bus_end import BusEnd
from simulator.description import ArmDescription, SimulationSettings
from simulator.events import SimulationEvent
from simulator.hand_script import AnyAct
from simulator.hand_socket import HandSocket
from simulator.socketcand import HELLO, Conversation, Reply, frame_line

PULSE_S = 0.001
"""Longest interval between two advances of the plant, with or without a SYNC."""
LONGEST_GAP_S = 0.1
"""Lag from which the simulation no longer tries to catch up."""
LONGEST_TURN_S = 0.002
"""Longest time simulated between two polls of the bus."""
SETTLING_S = 0.05
"""Time without frames after the answer to rawmode, which python-can reads as one chunk."""
MOST_UNSENT = 1 << 20
"""Number of unsent bytes from which a slow client is dropped."""


class RealTimeArm:
    """Simulated arm that follows CLOCK_MONOTONIC and reports its events as JSON lines."""

    def __init__(
        self,
        description: ArmDescription,
        settings: SimulationSettings,
        send: Callable[[can.Message], None],
        hand_script: Sequence[AnyAct],
        events: BinaryIO | None,
        hand: HandSocket | None = None,
    ) -> None:
        self._events, self._hand = events, hand
        self._origin = time.monotonic()
        self.arm = SimulatedArm(
            description, settings, send, hand_script=hand_script, on_event=self.report
        )
        self._origin = self._lived_s = time.monotonic()
        self._reported_s = 0.0
        self.arm.power_on()

    def live(self) -> float:
        """Advance the plant towards the present time, which is returned [s, monotonic].

        Frames are answered between calls, so a lagging plant catches up over several. If the
        machine is too slow for that, the drives' clocks advance without the plant; if this process
        was suspended, the lost time is left out for plant and drives.
        """
        now = time.monotonic()
        behind = now - self._origin - self.arm.now
        if behind > LONGEST_GAP_S:
            if now - self._lived_s > LONGEST_GAP_S:
                self._origin += behind - PULSE_S
                self._report_lag(now, f"held up for {behind:.3f} s, time left out")
            else:
                self.arm.skip(now - self._origin - PULSE_S)
                self._report_lag(now, f"too slow by {behind:.3f} s: the plant stood still")
        self._lived_s = now
        if self._hand is not None:
            self._hand.serve(self.arm.hand.take)
        self.arm.advance(min(now - self._origin, self.arm.now + LONGEST_TURN_S))
        return now

    def catch_up(self) -> None:
        """Advance the plant to the present time at once, by calls of `live`: needed before a frame,
        which may be a SYNC, at which drives sample."""
        while self.live() - self._origin - self.arm.now > PULSE_S:
            pass

    def _report_lag(self, now: float, text: str) -> None:
        if now - self._reported_s > 1.0:
            self._reported_s = now
            self.report(SimulationEvent(self.arm.now, "server", text))

    def report(self, event: SimulationEvent) -> None:
        """Write an event as a JSON line `{monotonic_s, simulated_s, kind, text}`."""
        if self._events is not None:
            line = {
                "monotonic_s": round(self._origin + event.at_s, 6),
                "simulated_s": round(event.at_s, 6),
                "kind": event.kind,
                "text": event.text,
            }
            try:
                self._events.write(msgspec.json.encode(line) + b"\n")
                self._events.flush()
            except OSError:  # the reader is gone; continue without it
                self._events = None


class _Client:
    """TCP connection with its queue of unsent bytes."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection = connection
        self.conversation = Conversation()
        self.takes_frames_from = float("inf")
        self.unsent = bytearray(HELLO)

    def flush(self) -> bool:
        """Send as much as the socket accepts; False if the client is gone or far too slow."""
        try:
            while self.unsent:
                del self.unsent[: self.connection.send(self.unsent)]
        except BlockingIOError:
            return len(self.unsent) < MOST_UNSENT
        except OSError:
            return False
        return True


class Server:
    """Socketcand server whose bus has one arm; `arm` is accessible to tests in this process."""

    def __init__(
        self,
        description: ArmDescription,
        settings: SimulationSettings,
        *,
        host: str = "127.0.0.1",
        port: int = 29536,
        hand_script: Sequence[AnyAct] = (),
        events: BinaryIO | None = None,
        hand: HandSocket | None = None,
    ) -> None:
        """Raises BusError if the port is not available; port 0 selects a free one, see `port`.
        hand: socket for requests to the hand."""
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.bind((host, port))
            self._listener.listen()
        except (OSError, OverflowError) as error:
            self._listener.close()
            used = getattr(error, "errno", 0) == errno.EADDRINUSE
            why = "another program uses this port, choose another: --port" if used else error
            raise BusError(f"cannot serve the simulated arm on {host}:{port}: {why}") from error
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._clients: dict[socket.socket, _Client] = {}
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        try:
            self._real_time = RealTimeArm(
                description, settings, self._broadcast, hand_script, events, hand
            )
        except Exception:
            self.close()
            raise
        self.arm = self._real_time.arm
        self._real_time.report(SimulationEvent(0.0, "server", f"listening on {host}:{self.port}"))

    def run(self, stop: threading.Event) -> None:
        """Serve until `stop` is set."""
        while not stop.is_set():
            self.turn(PULSE_S)

    def turn(self, timeout: float) -> None:
        """Wait up to `timeout` s for clients, serve them, and advance the plant."""
        ready = self._selector.select(timeout)
        now = self._real_time.live()
        for entry, _ in ready:
            if entry.fileobj is self._listener:
                self._accept()
            elif (client := self._clients.get(entry.data)) is not None:
                self._listen(client, now)
        for client in tuple(self._clients.values()):
            if client.unsent and not client.flush():
                self._drop(client)

    def close(self) -> None:
        """Close all sockets."""
        for client in tuple(self._clients.values()):
            self._drop(client)
        self._selector.close()
        self._listener.close()

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return
        self._clients[connection] = _Client(connection)
        self._selector.register(connection, selectors.EVENT_READ, connection)

    def _listen(self, client: _Client, now: float) -> None:
        try:
            data = client.connection.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(client)
            return
        for answer in client.conversation.feed(data):
            if isinstance(answer, Reply):
                client.unsent += answer.data
                if answer.raw_mode:
                    client.takes_frames_from = now + SETTLING_S
            else:
                client.takes_frames_from = min(client.takes_frames_from, now)
                self._broadcast(answer, client)
                self._real_time.catch_up()
                self._real_time.arm.receive(answer)

    def _broadcast(self, message: can.Message, sender: _Client | None = None) -> None:
        if not self._clients:
            return
        now = time.monotonic()
        line = frame_line(message, time.time())
        for client in self._clients.values():
            if client is not sender and now >= client.takes_frames_from:
                client.unsent += line

    def _drop(self, client: _Client) -> None:
        self._selector.unregister(client.connection)
        del self._clients[client.connection]
        client.connection.close()


def serve(server: Server) -> None:
    """Serve the arm until SIGTERM or SIGINT, then close the server."""
    try:
        server.run(_stop_on_signals())
    finally:
        server.close()


def serve_on_bus(
    description: ArmDescription,
    settings: SimulationSettings,
    *,
    interface: str,
    channel: str,
    hand_script: Sequence[AnyAct] = (),
    events: BinaryIO | None = None,
    hand: HandSocket | None = None,
    stop: threading.Event | None = None,
) -> None:
    """Simulate the nodes of the arm on a CAN bus until `stop`, SIGTERM or SIGINT; a lost bus is
    reopened. Raises BusError if it is missing at the start."""
    stop = stop or _stop_on_signals()
    reports: list[str] = []
    bus_end = BusEnd(interface, channel, reports.append)
    try:
        real_time = RealTimeArm(description, settings, bus_end.send, hand_script, events, hand)
        while not stop.is_set():
            message = bus_end.receive(PULSE_S)
            real_time.live()
            while message is not None:
                real_time.catch_up()
                real_time.arm.receive(message)
                message = bus_end.receive(0.0)
            while reports:
                real_time.report(SimulationEvent(real_time.arm.now, "server", reports.pop(0)))
    finally:
        bus_end.close()


def _stop_on_signals() -> threading.Event:
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    return stop
