"""COB-IDs, NMT commands and NMT states of CANopen: the predefined connection set of CiA 301.

The COB-ID of a node's service is the number here plus the node ID. The simulated drives define
their numbers independently, so that both cannot share a mistake.
"""

from typing import Final

NMT: Final = 0x000
SYNC: Final = 0x080
EMERGENCY: Final = 0x080
TPDO: Final = 0x180
RPDO: Final = 0x200
NEXT_PDO: Final = 0x100
"""Distance between the COB-IDs of consecutive PDOs of a node."""
SDO_ANSWER: Final = 0x580
SDO_REQUEST: Final = 0x600
HEARTBEAT: Final = 0x700

NODE: Final = 0x7F
"""Bits of a COB-ID that hold the node ID."""

START_NODE: Final = 1
STOP_NODE: Final = 2
ENTER_PRE_OPERATIONAL: Final = 128
RESET_NODE: Final = 129
RESET_COMMUNICATION: Final = 130

# NMT states in a heartbeat; boot-up is the first message after a start.
BOOT_UP: Final = 0
OPERATIONAL: Final = 5
