"""Settings of the bus, with bounds that are checked on reading."""

from typing import Annotated, Literal

from msgspec import Meta

from drivers.settings import Name, NodeId, Settings

Interface = Literal["socketcan", "socketcand", "slcan", "virtual"]


class BusSettings(Settings, frozen=True):
    """Address of the CAN bus: a python-can interface and its channel."""

    interface: Interface
    channel: Name
    bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000)] = 1_000_000
    host: Name = "127.0.0.1"  # of socketcand
    port: Annotated[int, Meta(ge=1, le=65535)] = 29536  # of socketcand
    master_node: NodeId = 127  # whose heartbeat the drives expect
