"""The errors of one drive by CiA 301: EMCY frames, error register 1001, error history 1003."""

from collections import deque
from collections.abc import Callable

from simulator.objects import Objects, key

HEARTBEAT_LOST = 0x8130
PDO_TOO_SHORT, PDO_TOO_LONG = 0x8210, 0x8220
GENERIC_ERROR, COMMUNICATION_ERROR = 0x01, 0x11
ERROR_REGISTER, HISTORY, ERROR_CODE = key(0x1001), key(0x1003), key(0x603F)
LONGEST_HISTORY = 8


class Emergencies:
    """Present error and history of a drive; `send(data)` puts an EMCY frame on the bus, as far as
    the drive's NMT state lets it."""

    def __init__(self, objects: Objects, send: Callable[[bytes], None]) -> None:
        self._objects, self._send = objects, send
        self._errors: deque[int] = deque(maxlen=LONGEST_HISTORY)

    @property
    def present(self) -> int:
        """Code of the error that is present; 0 for none."""
        return self._objects.number(ERROR_CODE >> 8)

    def raise_error(self, code: int, register: int = GENERIC_ERROR) -> None:
        """Show, remember and send a new error."""
        self._show(code, register)
        self._errors.appendleft(code)
        self.show_history()
        self._transmit(code, register)

    def clear_error(self) -> None:
        """End the error; the history stays."""
        self._show(0, 0)
        self.say_over()

    def say_over(self) -> None:
        """Send that the error is over, whatever the objects show."""
        self._transmit(0, 0)

    def forget(self) -> None:
        """Empty the history."""
        self._errors.clear()
        self.show_history()

    def show_history(self) -> None:
        """Write 1003 anew, e.g. after the communication objects were restored."""
        self._objects.show(HISTORY, len(self._errors))
        for sub in range(1, LONGEST_HISTORY + 1):
            error = self._errors[sub - 1] if sub <= len(self._errors) else 0
            self._objects.show(HISTORY + sub, error)

    def _show(self, code: int, register: int) -> None:
        self._objects.show(ERROR_REGISTER, register)
        self._objects.show(ERROR_CODE, code)

    def _transmit(self, code: int, register: int) -> None:
        self._send(code.to_bytes(2, "little") + bytes([register, 0, 0, 0, 0, 0]))
