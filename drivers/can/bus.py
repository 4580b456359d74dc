"""The CAN bus as the configuration names it."""

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

#: Errors of python-can's interfaces for a bus that is closed, down or full: not only its own.
BUS_FAILURES: Final = (can.CanError, OSError, ValueError)

# Keyed so that mypy names an interface of the settings that is forgotten here.
INTERFACES: Final[Mapping[Interface, Callable[[BusSettings], OpenBus]]] = {
    "socketcan": open_socketcan,
    "socketcand": open_socketcand,
    "slcan": open_slcan,
    "virtual": open_virtual,
}


def open_bus(settings: BusSettings) -> OpenBus:
    """Open the bus; raises BusError with advice."""
    try:
        return INTERFACES[settings.interface](settings)
    except (*BUS_FAILURES, ImportError) as error:
        raise BusError(f"bus {settings.interface} {settings.channel}: {error}") from error
