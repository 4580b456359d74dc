"""SDO server of one drive: that of canopen, driven frame by frame without a thread."""

from collections.abc import Callable
from typing import Any

from canopen.sdo import SdoServer

from simulator.objects import Objects


class _Wire:
    """Stand-in for the network and the node that canopen's SDO server expects."""

    def __init__(self, objects: Objects, send: Callable[[int, bytes], None]) -> None:
        self._objects, self._send = objects, send
        self.object_dictionary: Any = None

    def send_message(self, cob_id: int, data: bytes) -> None:
        self._send(cob_id, bytes(data))

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        return self._objects.read(index, subindex)

    def set_data(
        self, index: int, subindex: int, data: bytes, check_writable: bool = False
    ) -> None:
        self._objects.write(index, subindex, bytes(data))


def sdo_server(node: int, objects: Objects, send: Callable[[int, bytes], None]) -> Any:
    """SDO server whose `on_request(cob_id, data, 0.0)` answers by `send` before it returns."""
    wire = _Wire(objects, send)
    server = SdoServer(0x600 + node, 0x580 + node, wire)
    server.network = wire
    # Initialised, as canopen fails on a segment or abort without a transfer.
    server._index = server._subindex = 0
    server._buffer = bytearray()
    return server
