"""Expedited SDO to one drive within the tick: one request, whose answer is read like any frame.

Nothing blocks. An SDO acts at once, even in NMT pre-operational, and needs no SYNC or mapping: it
stops drives that no setpoint reaches, and confirms their standstill. An answer has eight bytes and
names its object, which separates it from answers to other clients (CiA 301, 7.2.4.3).
"""

import math
import struct
from collections.abc import Sequence
from typing import Final

import numpy as np

from drivers.api import PowerTarget
from drivers.can.wire import Frame
from drivers.canopen.cia402 import CONDITION_OF, DISABLE_VOLTAGE, QUICK_STOP, drive_state
from drivers.canopen.codec import STRUCT_CODES, WORDS, link_side, quantity
from drivers.canopen.ids import SDO_REQUEST
from drivers.canopen.settings import CanopenDrive, PdoEntry
from drivers.counts import correct
from drivers.drive import harmonics
from drivers.stopping.stop_watch import OBEYING, StopReading

#: Ticks without an answer after which a request is repeated; a late answer still counts.
ANSWER_TICKS: Final = 5

# First byte of a request and of its answer. In an upload answer, bits 2 and 3 hold the number of
# unused data bytes; bit 0 says that this number is given.
_WRITE_TWO_BYTES: Final = 0x2B
_WRITTEN: Final = 0x60
_READ: Final = 0x40
_VALUE, _VALUE_MASK = 0x42, 0xE2
_FRAME: Final = struct.Struct("<BHBHxx")
_PLACE: Final = struct.Struct("<xHB")

_WORD_OF: Final = {PowerTarget.QUICK_STOP: QUICK_STOP, PowerTarget.OFF: DISABLE_VOLTAGE}
_COMMAND_FRAMES: Final = {
    target: _FRAME.pack(_WRITE_TWO_BYTES, WORDS["controlword"], 0, word)
    for target, word in _WORD_OF.items()
}

# Steps in sequence: the command, then readings. After the velocity comes one of the drive's
# positions in turn, then the statusword again.
_COMMAND, _STATUSWORD, _VELOCITY = range(3)


class Reading:
    """Quantity of one drive that is read by SDO, in SI units at the link."""

    def __init__(self, drive: CanopenDrive, entry: PdoEntry) -> None:
        where = quantity(drive.profile, entry)
        self.place = where.object, where.subindex
        self.value = math.nan
        """Last value read; NaN before the first."""
        self._layout = struct.Struct("<" + STRUCT_CODES[where.type])
        self._gain, self._bias = link_side(drive, entry)
        self._harmonics = harmonics([drive])
        self._offset = np.array([drive.wiring.link_offset])
        self._corrected = entry == "link_position"

    def take(self, data: bytes | bytearray) -> None:
        """Decode an answer frame."""
        self.value = self._gain * self._layout.unpack_from(data, 4)[0] + self._bias
        if self._corrected:
            corrected = np.array([self.value])
            correct(corrected, self._offset, self._harmonics)
            self.value = float(corrected[0])


class ExpeditedStop:
    """SDO client that commands one drive to stop, and reads back whether it does."""

    def __init__(self, drive: CanopenDrive) -> None:
        self._velocity = Reading(drive, "motor_velocity")
        self._link = Reading(drive, "link_position")
        self._motor = Reading(drive, "motor_position") if drive.profile.motor_position else None
        self._positions = [self._link, *([self._motor] if self._motor else [])]
        self._cob_id = SDO_REQUEST + drive.node
        readings = (self._velocity, *self._positions)
        self._places = (
            (WORDS["controlword"], 0),
            (WORDS["statusword"], 0),
            *(reading.place for reading in readings),
        )
        self._ask = [_FRAME.pack(_READ, *place, 0) for place in self._places]
        self._step = _COMMAND
        self._next = 0  # index of the next position
        self._ticks_left = 0  # until the request is repeated; 0 if no answer is awaited
        self._statusword = 0
        self._seen: StopReading | None = None
        self.confirmed = False
        """True once the drive has acknowledged the command since `begin`."""

    def begin(self) -> None:
        """Start over with the command, discarding earlier readings."""
        self._step, self._ticks_left = _COMMAND, 0
        self._seen, self.confirmed = None, False
        for position in self._positions:
            position.value = math.nan

    def request(self, target: PowerTarget) -> Frame | None:
        """Request of this tick, towards `target`; None while an answer is awaited."""
        if self._ticks_left > 1:
            self._ticks_left -= 1
            return None
        self._ticks_left = ANSWER_TICKS
        data = _COMMAND_FRAMES[target] if self._step == _COMMAND else self._ask[self._step]
        return self._cob_id, data

    def on_sdo(self, data: bytes | bytearray) -> None:
        """Take a frame of its SDO server; answers that match no request of this client are
        ignored."""
        if not self._ticks_left or len(data) < 8 or _PLACE.unpack_from(data) != self._place:
            return
        self._ticks_left = 0
        step, value = self._step, data[0] & _VALUE_MASK == _VALUE
        if step == _COMMAND:
            # The state is read even if the drive refuses the command.
            self.confirmed = self.confirmed or data[0] == _WRITTEN
            self._step = _STATUSWORD
        elif not value:
            # A refused reading is no observation: start over.
            self._step = _COMMAND
        elif step == _STATUSWORD:
            self._statusword = data[4] | data[5] << 8
            self._step = _VELOCITY
        elif step == _VELOCITY:
            self._velocity.take(data)
            self._see()
        else:
            self._positions[self._next].take(data)
            self._next = (self._next + 1) % len(self._positions)
            self._step = _STATUSWORD

    def _see(self) -> None:
        """Store the reading, and choose the next step."""
        condition = CONDITION_OF[drive_state(self._statusword)]
        self._seen = StopReading(
            condition,
            self._velocity.value,
            position=self._link.value,
            motor=self._motor.value if self._motor else math.nan,
            asked=True,
        )
        self._step = _VELOCITY + 1 + self._next if condition in OBEYING else _COMMAND

    @property
    def _place(self) -> tuple[int, int]:
        return self._places[self._step]

    def take(self) -> StopReading | None:
        """Reading since the last call; None if there was none."""
        seen, self._seen = self._seen, None
        return seen


def expedited_quick_stops(drives: Sequence[CanopenDrive]) -> list[Frame]:
    """Quick-stop request to each drive by SDO, for use without reading the answers."""
    return [(SDO_REQUEST + drive.node, _COMMAND_FRAMES[PowerTarget.QUICK_STOP]) for drive in drives]
