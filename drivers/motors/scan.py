"""Scan of a bus for motors of one make: no commands, and no requests if a master is present."""

from collections.abc import Callable, Iterable
from typing import Final, TypeVar

from common.errors import BusError
from drivers.can.bus import BUS_FAILURES
from drivers.can.wire import Wire, digits_of
from drivers.motors.queries import received_frames

LISTEN_S: Final = 0.15  # for a master

T = TypeVar("T")


def scanned(
    wire: Wire,
    motors: Iterable[int],
    commands: Callable[[int], bool],
    found: Callable[[Wire, int], T | None],
) -> list[T]:
    """Motors that answer, as returned by `found`; commands: True for the identifier of a command.
    Raises BusError if a master commands motors, or the bus fails."""
    try:
        for can_id, _ in received_frames(wire, LISTEN_S):
            if commands(can_id):
                seen = f"0x{digits_of(can_id).decode()} is being sent"
                raise BusError(f"a master commands motors on this bus: {seen}")
        each = (found(wire, motor) for motor in motors)
        return [one for one in each if one is not None]
    except BUS_FAILURES as error:
        raise BusError(f"the bus cannot be scanned: {error}") from error
