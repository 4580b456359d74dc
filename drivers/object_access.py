"""Objects of one drive by SDO; every failure is one DriveError in words. Never inside the tick."""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import can
import canopen
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from drivers.bus import BUS_FAILURES, connection_lost
from drivers.drive_setup import DriveSetup, find_object
from errors import BusError, DriveError

_READER_CYCLE_S: Final = 0.02


@contextmanager
def sdo_network(bus: can.BusABC) -> Iterator[canopen.Network]:
    """A canopen network on an open bus; leaving it stops its reader, and keeps the bus open."""
    network = canopen.Network(bus)
    reader = can.Notifier(bus, network.listeners, timeout=_READER_CYCLE_S)
    try:
        yield network
    finally:
        reader.stop()


class ObjectAccess:
    """Reads and writes integer objects of one drive."""

    def __init__(self, network: canopen.Network, setup: DriveSetup, timeout_s: float) -> None:
        self._setup = setup
        self._network = network
        self._node = network.add_node(setup.wiring.node, setup.data_sheet)
        self._node.sdo.RESPONSE_TIMEOUT = timeout_s
        # An expedited transfer may be repeated without harm; one frame may be lost.
        self._node.sdo.MAX_RETRIES = 2

    def enter_pre_operational(self) -> None:
        """PDOs off; the drive keeps the power state and the torque that it has."""
        with self._words("NMT pre-operational"):
            self._node.nmt.state = "PRE-OPERATIONAL"

    def has(self, index: int, subindex: int = 0) -> bool:
        """Whether the EDS has the object."""
        return find_object(self._setup.data_sheet, index, subindex) is not None

    def read(self, index: int, subindex: int = 0) -> int:
        """Value of an integer object; raises DriveError or BusError."""
        with self._words(f"object 0x{index:04X}:{subindex:02X}: reading"):
            return int(self._node.sdo.get_variable(index, subindex).raw)

    def write(self, index: int, subindex: int, value: int) -> None:
        """Write, and read back; raises DriveError if the drive refuses or does not hold it."""
        self.write_only(index, subindex, value)
        held = self.read(index, subindex)
        if held != value:
            raise DriveError(
                f"{self._setup}: object 0x{index:04X}:{subindex:02X} was written {value}, "
                f"reads {held}"
            )

    def write_only(self, index: int, subindex: int, value: int) -> None:
        """Write without reading back: for values that the drive completes by itself."""
        with self._words(f"object 0x{index:04X}:{subindex:02X}: writing {value}"):
            self._node.sdo.get_variable(index, subindex).raw = value

    @contextmanager
    def _words(self, doing: str) -> Iterator[None]:
        try:
            yield
        except SdoAbortedError as error:
            words = SdoAbortedError.CODES.get(error.code, "reason unknown")
            raise DriveError(
                f"{self._setup}: {doing} was refused: {words} (0x{error.code:08X})"
            ) from error
        except SdoCommunicationError as error:
            if connection_lost(self._network.bus):
                raise BusError("the connection to the bus is gone") from error
            timeout_ms = round(1000 * self._node.sdo.RESPONSE_TIMEOUT)
            raise DriveError(
                f"{self._setup} does not answer (SDO timeout {timeout_ms} ms; {doing}: {error})"
            ) from error
        except struct.error as error:
            raise DriveError(f"{self._setup}: {doing}: the answer is malformed") from error
        except BUS_FAILURES as error:
            raise BusError(f"{self._setup}: {doing}: {error}") from error
