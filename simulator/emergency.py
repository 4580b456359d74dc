"""Errors of one drive by CiA 301: EMCY frames, error register 1001, error history 1003."""

from collections import deque
from collections.abc import Callable

from simulator.objects import Objects, key

HEARTBEAT_LOST = 0x8130
PDO_TOO_SHORT, PDO_TOO_LONG = 0x8210, 0x8220
GENERIC_ERROR, COMMUNICATION_ERROR = 0x01, 0x11
ERROR_REGISTER, HISTORY, ERROR_CODE = key(0x1001), key(0x1003), key(0x603F)
LONGEST_HISTORY = 8


class Emergencies:
    """Present error and error history of a drive; `send(data)` sends an EMCY frame if the drive's
    NMT state permits it."""

    def __init__(self, objects: Objects, send: Callable[[bytes], None]) -> None:
        self._objects, self._send = objects, send
        self._errors: deque[int] = deque(maxlen=LONGEST_HISTORY)

    @property
    def present(self) -> int:
        """Code of the present error; 0 for none."""
        return self._objects.number(ERROR_CODE >> 8)

    def raise_error(self, code: int, register: int = GENERIC_ERROR) -> None:
        """Raise a new error: update the objects and the history, and send it."""
        self._show(code, register)
        self._errors.appendleft(code)
        self.show_history()
        self._transmit(code, register)

    def clear_error(self) -> None:
        """Clear the error; the history stays."""
        self._show(0, 0)
        self.say_over()

    def say_over(self) -> None:
        """Send the end of the error (EMCY 0), whatever the objects contain."""
        self._transmit(0, 0)

    def forget(self) -> None:
        """Clear the history."""
        self._errors.clear()
        self.show_history()

    def show_history(self) -> None:
        """Write the history to 1003, e.g. after the communication objects were restored."""
        self._objects.show(HISTORY, len(self._errors))
        for sub in range(1, LONGEST_HISTORY + 1):
            error = self._errors[sub - 1] if sub <= len(self._errors) else 0
            self._objects.show(HISTORY + sub, error)

    def _show(self, code: int, register: int) -> None:
        self._objects.show(ERROR_REGISTER, register)
        self._objects.show(ERROR_CODE, code)

    def _transmit(self, code: int, register: int) -> None:
        self._send(code.to_bytes(2, "little") + bytes([register, 0, 0, 0, 0, 0]))
