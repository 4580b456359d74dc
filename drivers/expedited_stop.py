"""Expedited SDO to one drive inside the tick: one frame out, its answer read like any other.

Nothing waits. An SDO acts at once, in NMT pre-operational, too, and needs neither SYNC nor mapping:
it stops drives that no setpoint reaches, and sees them stand. An answer has eight bytes and names
its object, so that one to somebody else is told from it (CiA 301, 7.2.4.3).
"""

import struct
from collections.abc import Sequence
from typing import Final

from drivers.can.wire import Frame
from drivers.cia402 import DISABLE_VOLTAGE, QUICK_STOP, PowerTarget, drive_state
from drivers.codec import STRUCT_CODES, WORDS, link_side, quantity
from drivers.drive import Drive
from drivers.ids import SDO_REQUEST
from drivers.stop_stages import OBEYING, Seen

#: Without an answer for so many ticks the question is sent again; a late answer still counts.
ANSWER_TICKS: Final = 5

# First byte of a request and of its answer. In that of a value, bits 2 and 3 say how many of its
# four bytes do not count, bit 0 whether they say so.
_WRITE_TWO_BYTES: Final = 0x2B
_WRITTEN: Final = 0x60
_READ: Final = 0x40
_VALUE, _VALUE_MASK = 0x42, 0xE2
_FRAME: Final = struct.Struct("<BHBHxx")
_PLACE: Final = struct.Struct("<xHB")

_WORD_OF: Final = {PowerTarget.QUICK_STOP: QUICK_STOP, PowerTarget.OFF: DISABLE_VOLTAGE}
_TELL_FRAMES: Final = {
    target: _FRAME.pack(_WRITE_TWO_BYTES, WORDS["controlword"], 0, word)
    for target, word in _WORD_OF.items()
}

# What a drive is told and asked, one after the other; after the last the statusword again.
_TELL, _STATUSWORD, _VELOCITY = range(3)


class ExpeditedStop:
    """Client that tells one drive to stop, and reads whether it does."""

    def __init__(self, drive: Drive) -> None:
        velocity = quantity(drive.profile, "motor_velocity")
        self._gain, self._bias = link_side(drive, "motor_velocity")
        self._layout = struct.Struct("<" + STRUCT_CODES[velocity.type])
        self._cob_id = SDO_REQUEST + drive.node
        self._places = (
            (WORDS["controlword"], 0),
            (WORDS["statusword"], 0),
            (velocity.object, velocity.subindex),
        )
        self._ask = [_FRAME.pack(_READ, *place, 0) for place in self._places]
        self._step = _TELL
        self._ticks_left = 0  # for an answer; 0 when none is awaited
        self._statusword = 0
        self._seen: Seen | None = None
        self.confirmed = False
        """The drive has taken the command since `begin`."""

    def begin(self) -> None:
        """Tell it first, whatever it has said before."""
        self._step, self._ticks_left = _TELL, 0
        self._seen, self.confirmed = None, False

    def request(self, target: PowerTarget) -> Frame | None:
        """Frame of this tick, towards `target`; None while an answer is awaited."""
        if self._ticks_left > 1:
            self._ticks_left -= 1
            return None
        self._ticks_left = ANSWER_TICKS
        data = _TELL_FRAMES[target] if self._step == _TELL else self._ask[self._step]
        return self._cob_id, data

    def hear(self, data: bytes | bytearray) -> None:
        """Take a frame of its SDO server; one that answers nobody's, or somebody else's, request
        changes nothing."""
        if not self._ticks_left or len(data) < 8 or _PLACE.unpack_from(data) != self._place:
            return
        self._ticks_left = 0
        step, value = self._step, data[0] & _VALUE_MASK == _VALUE
        if step == _TELL:
            # A drive that refuses is asked what it does all the same.
            self.confirmed = self.confirmed or data[0] == _WRITTEN
            self._step = _STATUSWORD
        elif not value:
            # A drive that does not say how it is was not seen.
            self._step = _TELL
        elif step == _STATUSWORD:
            self._statusword = data[4] | data[5] << 8
            self._step = _VELOCITY
        else:
            velocity = self._gain * self._layout.unpack_from(data, 4)[0] + self._bias
            self._seen = Seen(drive_state(self._statusword), velocity)
            self._step = _STATUSWORD if self._seen.state in OBEYING else _TELL

    @property
    def _place(self) -> tuple[int, int]:
        return self._places[self._step]

    def take(self) -> Seen | None:
        """What was read since the last call; None if nothing was."""
        seen, self._seen = self._seen, None
        return seen


def expedited_quick_stops(drives: Sequence[Drive]) -> list[Frame]:
    """Quick stop of each drive by SDO, for when nobody will read the answers."""
    return [(SDO_REQUEST + drive.node, _TELL_FRAMES[PowerTarget.QUICK_STOP]) for drive in drives]
