"""CAN bus, opened by the interface that the configuration names."""

from collections.abc import Callable, Mapping
from typing import Final

import can

from common.errors import BusError
from drivers.can.settings import BusSettings, Interface
from drivers.can.slcan import open_slcan
from drivers.can.socketcan import open_socketcan
from drivers.can.socketcand import open_socketcand
from drivers.can.virtual import open_virtual
from drivers.can.wire import OpenBus

#: Errors that python-can's interfaces raise for a bus that is closed, down or full.
BUS_FAILURES: Final = (can.CanError, OSError, ValueError)

# Keyed by Interface, so that mypy reports an interface missing here.
INTERFACES: Final[Mapping[Interface, Callable[[BusSettings], OpenBus]]] = {
    "socketcan": open_socketcan,
    "socketcand": open_socketcand,
    "slcan": open_slcan,
    "virtual": open_virtual,
}


def open_bus(settings: BusSettings) -> OpenBus:
    """Open the bus. Raises BusError, with advice where possible."""
    try:
        return INTERFACES[settings.interface](settings)
    except (*BUS_FAILURES, ImportError) as error:
        raise BusError(f"bus {settings.interface} {settings.channel}: {error}") from error
