"""Socketcand protocol in raw mode, as far as python-can's client uses it; no I/O here."""

from dataclasses import dataclass

import can

HELLO = b"< hi >"
OK = b"< ok >"
REFUSED = b"< error unknown command >"
LONGEST_COMMAND = 200


@dataclass(frozen=True, slots=True)
class Reply:
    """Reply to this client."""

    data: bytes
    raw_mode: bool = False
    """True if the client receives frames from now on."""


class Conversation:
    """Server side of one client's connection: bytes in, replies and frames out."""

    def __init__(self) -> None:
        self._buffer = b""
        self._opened = self.raw_mode = False

    def feed(self, data: bytes) -> list[Reply | can.Message]:
        """Parse received bytes into replies and frames, in order. Commands may arrive in pieces."""
        self._buffer += data
        answers: list[Reply | can.Message] = []
        while (end := self._buffer.find(b">")) >= 0:
            command, self._buffer = self._buffer[: end + 1], self._buffer[end + 1 :]
            answers.append(self._answer(command.strip()))
        if len(self._buffer) > LONGEST_COMMAND:
            self._buffer = b""
            answers.append(Reply(REFUSED))
        return answers

    def _answer(self, command: bytes) -> Reply | can.Message:
        words = command.split()
        if len(words) < 3 or words[0] != b"<" or words[-1] != b">":
            return Reply(REFUSED)
        verb, arguments = words[1], words[2:-1]
        if verb == b"open" and len(arguments) == 1:
            self._opened = True
            return Reply(OK)
        if verb == b"rawmode" and self._opened:
            self.raw_mode = True
            return Reply(OK, raw_mode=True)
        if verb == b"send" and self.raw_mode:
            message = _frame(arguments)
            if message is not None:
                return message
        return Reply(REFUSED)


def _frame(words: list[bytes]) -> can.Message | None:
    """Frame from `ID LENGTH BYTE...`, all hexadecimal; an eight-digit ID is extended. None if
    invalid."""
    try:
        numbers = [int(word, 16) for word in words]
    except ValueError:
        return None
    if len(numbers) < 2 or not 0 <= numbers[1] <= 8 or len(numbers) != 2 + numbers[1]:
        return None
    cob_id, data, extended = numbers[0], numbers[2:], len(words[0]) > 3
    if not 0 <= cob_id <= (0x1FFFFFFF if extended else 0x7FF):
        return None
    if any(not 0 <= byte <= 0xFF for byte in data):
        return None
    return can.Message(arbitration_id=cob_id, data=data, is_extended_id=extended)


def frame_line(message: can.Message, timestamp: float) -> bytes:
    """Text of a frame for the server's clients; timestamp in s."""
    width = 8 if message.is_extended_id else 3
    text = f"< frame {message.arbitration_id:0{width}X} {timestamp:.6f} {message.data.hex()} >"
    return text.encode("ascii")
