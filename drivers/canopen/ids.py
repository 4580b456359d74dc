"""COB-IDs, NMT commands and NMT states of CANopen: CiA 301's predefined connection set.

A COB-ID of a node is the service's number here plus the node's. The simulated drives have numbers
of their own, so that they cannot share a mistake.
"""

from typing import Final

NMT: Final = 0x000
SYNC: Final = 0x080
EMERGENCY: Final = 0x080
TPDO: Final = 0x180
RPDO: Final = 0x200
NEXT_PDO: Final = 0x100
"""From a PDO's COB-ID to that of the same node's next."""
SDO_ANSWER: Final = 0x580
SDO_REQUEST: Final = 0x600
HEARTBEAT: Final = 0x700

NODE: Final = 0x7F
"""The bits of a COB-ID that are the node's number."""

START_NODE: Final = 1
STOP_NODE: Final = 2
ENTER_PRE_OPERATIONAL: Final = 128
RESET_NODE: Final = 129
RESET_COMMUNICATION: Final = 130

# NMT states in a heartbeat; boot-up is the first of all.
BOOT_UP: Final = 0
OPERATIONAL: Final = 5
