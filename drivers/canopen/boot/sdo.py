"""SDO access to the objects of one drive; failures raise DriveError. Never used inside the tick."""

import queue
import struct
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

import canopen
from canopen.objectdictionary import ODVariable
from canopen.sdo import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from common.errors import BusError, DriveError, SilentDriveError
from drivers.can.bus import BUS_FAILURES
from drivers.canopen.boot.data_sheet import find_object
from drivers.canopen.boot.required_objects import DriveSetup
from drivers.canopen.ids import NMT, SDO_ANSWER, SDO_REQUEST

_SLICE_S: Final = 0.005
_ABORT: Final = b"\x80"
#: Number of requests answered twice that proves two drives. Only requests for communication objects
#: count: another tool may be polling the statusword by this node's SDO.
TWICE: Final = 3
_OF_COMMUNICATION: Final = range(0x1000, 0x2000)
#: First bytes (without their low bits) of requests that name an object.
_BEGIN: Final = (0x40, 0x20)
#: Bound on a segmented answer [bytes]: all objects read here are shorter.
LONGEST_ANSWER: Final = 256


class _Client(SdoClient):  # type: ignore[misc]
    """canopen's client, which calls `meanwhile` as it waits, and counts duplicate answers."""

    def __init__(
        self, network: canopen.Network, setup: DriveSetup, meanwhile: Callable[[], None]
    ) -> None:
        node = setup.drive.node
        super().__init__(SDO_REQUEST + node, SDO_ANSWER + node, setup.data_sheet)
        self.MAX_RETRIES = 1
        self.network, self._meanwhile = network, meanwhile
        self.twice = 0
        """Requests that were answered twice; not counted after a late answer."""
        self._in_time = True
        # Objects named by the last requests, with one list entry per answer.
        self._places: deque[tuple[bytes, list[None]]] = deque(maxlen=2)
        network.subscribe(SDO_ANSWER + node, self.on_response)

    def send_request(self, request: bytes) -> None:
        """Send a request, and record the requested object."""
        index = request[1] | request[2] << 8
        if request[0] & 0xE0 in _BEGIN and index in _OF_COMMUNICATION:
            self._places.append((bytes(request[1:4]), []))
        super().send_request(request)

    def on_response(self, can_id: int, data: bytes, timestamp: float) -> None:
        """Take an answer, and count those that repeat one."""
        for place, answers in reversed(self._places):
            if bytes(data[1:4]) == place:
                self.twice += bool(answers) and self._in_time
                answers.append(None)
                break
        super().on_response(can_id, data, timestamp)

    def read_response(self) -> bytes:
        """Next answer. Raises SdoAbortedError, SdoCommunicationError on timeout, or BusError if the
        bus can no longer be read."""
        give_up = time.monotonic() + self.RESPONSE_TIMEOUT
        in_time = True
        while in_time:
            self._meanwhile()
            left = give_up - time.monotonic()
            in_time = left > 0.0  # the last pass takes an answer that arrived in time, read late
            try:
                answer: bytes = self.responses.get(timeout=min(max(left, 0.0), _SLICE_S))
            except queue.Empty:
                self.network.check()
                continue
            if answer[:1] == _ABORT:
                raise SdoAbortedError(struct.unpack_from("<L", answer, 4)[0])
            return answer
        self._in_time = False  # a late answer might look like a duplicate
        raise SdoCommunicationError("no answer")


class ObjectAccess:
    """Access to the objects of one drive by expedited or segmented SDO.

    Transfers are not retried here, and none begins after `deadline` (monotonic clock): retries are
    up to the caller. `meanwhile` is called while an answer is awaited.
    """

    def __init__(
        self,
        network: canopen.Network,
        setup: DriveSetup,
        timeout_s: float,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> None:
        self.deadline = float("inf")
        self._setup, self._timeout_s = setup, timeout_s
        self._network, self._meanwhile = network, meanwhile
        self._client = _Client(network, setup, meanwhile)
        self._client.RESPONSE_TIMEOUT = timeout_s

    def has(self, index: int, subindex: int = 0) -> bool:
        """True if the EDS has the object."""
        return find_object(self._setup.data_sheet, index, subindex) is not None

    def writable(self, index: int, subindex: int = 0) -> bool:
        """True if the EDS declares the object writable."""
        return bool(self._variable(index, subindex).writable)

    def read(self, index: int, subindex: int = 0) -> int:
        """Read an integer object. Raises DriveError or BusError."""
        variable = self._variable(index, subindex)
        data = self._upload(index, subindex)
        size = len(variable) // 8
        if len(data) < size:
            raise SilentDriveError(
                f"{self._setup}: object 0x{index:04X}:{subindex:02X}: the answer is malformed "
                f"({len(data)} bytes, {size} expected)"
            )
        # Some drives pad an answer to four bytes.
        return int(variable.decode_raw(data[:size]))

    def read_text(self, index: int, subindex: int = 0) -> str:
        """Read a string object, usually by segmented upload. Raises DriveError or BusError."""
        text = self._upload(index, subindex).decode("utf-8", "replace")
        return "".join(c for c in text if c.isprintable()).strip()

    def write(self, index: int, subindex: int, value: int, name: str = "") -> None:
        """Write and read back. Raises DriveError if the drive refuses or does not keep a value."""
        self.write_only(index, subindex, value)
        self.compare(index, subindex, value, name, "was written")

    def hold(self, index: int, subindex: int, value: int, name: str = "") -> None:
        """Write and read back an object that the EDS declares writable; otherwise only compare."""
        if self.writable(index, subindex):
            self.write(index, subindex, value, name)
        else:
            self.compare(index, subindex, value, name)

    def compare(
        self, index: int, subindex: int, value: int, name: str = "", verb: str = "must be"
    ) -> None:
        """Read an object. Raises DriveError if it differs from `value`."""
        held = self.read(index, subindex)
        if held != value:
            name = name or f"object 0x{index:04X}:{subindex:02X}"
            raise DriveError(f"{self._setup}: {name} {verb} {value}, reads {held}")

    def write_only(self, index: int, subindex: int, value: int) -> None:
        """Write without reading back, for values that the drive modifies on its own."""
        data = self._variable(index, subindex).encode_raw(value)
        with self._translated(f"object 0x{index:04X}:{subindex:02X}: writing {value}"):
            self._client.download(index, subindex, data)

    def nmt(self, command: int, name: str) -> None:
        """Send this drive an NMT command."""
        with self._translated(f"NMT {name}"):
            self._network.send_message(NMT, [command, self._setup.drive.node])

    def settle(self) -> None:
        """Wait for a late answer, so that it is not mistaken for the answer to the next request."""
        end = time.monotonic() + self._timeout_s
        while time.monotonic() < end:
            self._meanwhile()
            time.sleep(_SLICE_S)

    def _variable(self, index: int, subindex: int) -> ODVariable:
        variable = self._setup.data_sheet.get_variable(index, subindex)
        assert variable is not None, f"0x{index:04X}:{subindex:02X} was checked against the EDS"
        return variable

    def _upload(self, index: int, subindex: int) -> bytes:
        doing = f"object 0x{index:04X}:{subindex:02X}: reading"
        data = b""
        with self._translated(doing):
            stream = self._client.open(index, subindex, "rb", buffering=0)
            while part := stream.read(7):
                data += part
                if len(data) > LONGEST_ANSWER:
                    raise SilentDriveError(f"{self._setup}: {doing}: the answer does not end")
        return data

    @contextmanager
    def _translated(self, doing: str) -> Iterator[None]:
        if time.monotonic() > self.deadline:
            raise SilentDriveError(f"{self._setup}: out of time before {doing}")
        if self._client.twice >= TWICE:
            raise DriveError(
                f"two drives answer as {self._setup}: its SDO requests get two answers; switch one "
                "off, and give it another node ID"
            )
        try:
            yield
        except SdoAbortedError as error:
            words = SdoAbortedError.CODES.get(error.code, "reason unknown")
            raise DriveError(
                f"{self._setup}: {doing} was refused: {words} (0x{error.code:08X})"
            ) from error
        except SdoCommunicationError as error:
            timeout_ms = round(1000 * self._timeout_s)
            raise SilentDriveError(
                f"{self._setup} does not answer (SDO timeout {timeout_ms} ms; {doing}: {error})"
            ) from error
        except struct.error as error:
            raise SilentDriveError(f"{self._setup}: {doing}: the answer is malformed") from error
        except BUS_FAILURES as error:
            raise BusError(f"{self._setup}: {doing}: {error}") from error
