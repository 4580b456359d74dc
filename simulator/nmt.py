"""NMT states of a CANopen node."""

from enum import IntEnum


class Nmt(IntEnum):
    """NMT states, with their values in a heartbeat."""

    BOOT = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127
