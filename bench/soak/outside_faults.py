"""Faults that come to a running daemon from outside: foreign frames on its bus, and processes that
stand still for a while."""

import os
import signal
import socket
import time
from collections.abc import Callable, Sequence
from random import Random

from bench.rigs import foreign_tool
from bench.rigs.drive_faults import OTHER_MODE
from bench.rigs.processes import Pair
from bench.rigs.speech import HOT
from drivers.canopen.ids import (
    EMERGENCY,
    ENTER_PRE_OPERATIONAL,
    NMT,
    RESET_NODE,
    RPDO,
    SDO_REQUEST,
    STOP_NODE,
    SYNC,
)
from drivers.canopen.settings import CanopenDrive

Fault = Callable[[Pair, Random, Sequence[CanopenDrive]], None]
"""Makes the fault, and returns when its cause is gone, or lasts until `reset` mends it."""


def say(port: int, *frames: tuple[int, bytes]) -> None:
    """Put frames on the simulated bus as one more client of its socketcand server."""
    with socket.create_connection(("127.0.0.1", port), timeout=5.0) as stream:
        for word in (b"", b"< open can0 >", b"< rawmode >"):
            stream.sendall(word)
            stream.recv(64)  # < hi >, < ok >, < ok >
        for cob_id, data in frames:
            octets = " ".join(f"{byte:02X}" for byte in data)
            stream.sendall(f"< send {cob_id:03X} {len(data)} {octets} >".encode())
        time.sleep(0.05)


def _hold_up(pid: int, seconds: float) -> None:
    os.kill(pid, signal.SIGSTOP)
    try:
        time.sleep(seconds)
    finally:
        os.kill(pid, signal.SIGCONT)


def emergency(both: Pair, rng: Random, drives: Sequence[CanopenDrive]) -> None:
    """A drive is too hot for a second."""
    node = rng.choice(drives).node
    code = HOT.to_bytes(2, "little")
    say(both.port, (EMERGENCY + node, code + bytes([0x08, 0, 0, 0, 0, 0])))
    time.sleep(1.0)
    say(both.port, (EMERGENCY + node, bytes(8)))


def drive_restarts(both: Pair, rng: Random, drives: Sequence[CanopenDrive]) -> None:
    """A drive is restarted, and has lost its set-up."""
    say(both.port, (NMT, bytes([RESET_NODE, rng.choice(drives).node])))


def drive_stopped(both: Pair, rng: Random, drives: Sequence[CanopenDrive]) -> None:
    """A drive is commanded to be silent."""
    command = rng.choice((STOP_NODE, ENTER_PRE_OPERATIONAL))
    say(both.port, (NMT, bytes([command, rng.choice(drives).node])))


def foreign_sync(both: Pair, rng: Random, drives: Sequence[CanopenDrive]) -> None:
    """Another node sends the SYNC, too."""
    say(both.port, (SYNC, b""))


def foreign_setpoint(both: Pair, rng: Random, drives: Sequence[CanopenDrive]) -> None:
    """Another node takes a drive's voltage away."""
    say(both.port, (RPDO + rng.choice(drives).node, bytes(6)))


def sync_moved(both: Pair, rng: Random, drives: Sequence[CanopenDrive]) -> None:
    """A tool gives SYNC another identifier in one drive."""
    say(both.port, (SDO_REQUEST + rng.choice(drives).node, foreign_tool.sync_moved()))


def sync_lost(both: Pair, rng: Random, drives: Sequence[CanopenDrive]) -> None:
    """No drive knows our SYNC for a while."""
    nodes = [SDO_REQUEST + drive.node for drive in drives]
    say(both.port, *((node, foreign_tool.sync_moved()) for node in nodes))
    time.sleep(rng.choice((0.05, 0.3, 2.0)))
    say(both.port, *((node, foreign_tool.sync_back()) for node in nodes))


def mode_changed(both: Pair, rng: Random, drives: Sequence[CanopenDrive]) -> None:
    """A tool chooses another mode of operation in one drive."""
    node = rng.choice(drives).node
    say(both.port, (SDO_REQUEST + node, foreign_tool.mode_changed(OTHER_MODE["romeo"])))


def rpdo_off(both: Pair, rng: Random, drives: Sequence[CanopenDrive]) -> None:
    """A tool turns the RPDO off that brings one drive its target velocity."""
    drive = rng.choice(drives)
    say(both.port, (SDO_REQUEST + drive.node, foreign_tool.rpdo_off(drive)))


def drives_held_up(both: Pair, rng: Random, drives: Sequence[CanopenDrive]) -> None:
    """No drive is heard for a while: a tick, stale samples, or no heartbeats."""
    _hold_up(both.simulator.pid, rng.choice((0.015, 0.05, 0.3)))


def daemon_held_up(both: Pair, rng: Random, drives: Sequence[CanopenDrive]) -> None:
    """A late tick, an overrun, or the drives miss the master."""
    _hold_up(both.daemon.pid, rng.choice((0.015, 0.06, 0.15, 0.3, 1.0, 3.0)))


FAULTS: tuple[Fault, ...] = (
    emergency, drive_restarts, drive_stopped, foreign_sync, foreign_setpoint, sync_moved, sync_lost,
    mode_changed, rpdo_off, drives_held_up, daemon_held_up,
)  # fmt: skip
