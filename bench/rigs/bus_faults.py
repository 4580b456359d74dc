"""Faults of the bus: frames lost, late or somebody else's, and failing adapters."""

import errno
from collections.abc import Iterator

import can

from bench.rigs.breakable_arm import ELBOW, BreakableArm, Fault, for_ever
from drivers.can.wire import ERROR


def one_pdo_missing(on: BreakableArm) -> Iterator[None]:
    with on.losing(0x281 + ELBOW):
        yield


def pdos_stale(on: BreakableArm) -> Iterator[None]:
    with on.losing(0x181 + ELBOW, 0x281 + ELBOW):
        yield from for_ever()


def pdos_lost_in_turn(on: BreakableArm) -> Iterator[None]:
    """Never a tick with all drives, never two in a row without the same one."""
    while True:
        for node in (1, 2):
            with on.losing(0x180 + node):
                yield


def pdos_stale_on_a_late_machine(on: BreakableArm) -> Iterator[None]:
    with on.losing(0x181 + ELBOW, 0x281 + ELBOW), on.late(0.012):
        for _ in range(4):
            yield


def foreign(cob_id: int, data: bytes = b"") -> Fault:
    def fault(on: BreakableArm) -> Iterator[None]:
        on.wire.add(cob_id, data)
        yield

    return fault


def _full_queue() -> Exception:
    return can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)


def one_enobufs(on: BreakableArm) -> Iterator[None]:
    with on.raising(_full_queue()):
        yield


def enobufs(on: BreakableArm) -> Iterator[None]:
    with on.raising(_full_queue()):
        for _ in range(5):
            yield


def bus_down(on: BreakableArm) -> Iterator[None]:
    down = can.CanOperationError("Error receiving: Network is down", errno.ENETDOWN)
    with on.raising(down, down):
        for _ in range(20):
            yield


def old_frames(on: BreakableArm) -> Iterator[None]:
    """The bus returns, and every drive's answers of the last half second come at once."""
    drives = on.rig.arm.drives
    for _ in range(4):
        for _ in range(50):
            for drive in drives:
                on.wire.add(0x180 + drive.node, bytes(8))
                on.wire.add(0x280 + drive.node, bytes(8))
        yield


def error_passive(on: BreakableArm) -> Iterator[None]:
    on.wire.add(0x004 | ERROR, b"\0\x20\0\0\0\0\0\0")
    yield


def bus_off(on: BreakableArm) -> Iterator[None]:
    on.wire.add(0x040 | ERROR, bytes(8))
    with on.raising(_full_queue()):
        yield


def adapter_gone(on: BreakableArm) -> Iterator[None]:
    with on.raising(
        OSError(errno.ENODEV, "No such device"), OSError(errno.ENODEV, "No such device")
    ):
        yield from for_ever()
