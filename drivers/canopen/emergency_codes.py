"""Error codes of EMCY messages (0x603F), their classes and texts, after CiA 301, 7.2.7.1, and the
annex on error codes of CiA 402-2.
"""

from typing import Final

#: Classes of error codes (CiA 301): communication errors, after which some drives accept a reset
#: only when set up again; and protocol errors, about frames sent to them.
COMMUNICATION_ERROR: Final = 0x8100
PROTOCOL_ERROR: Final = 0x8200
#: The drive misses the master's heartbeat.
MASTER_SILENT: Final = 0x8130
OF_COMMUNICATION: Final = frozenset({COMMUNICATION_ERROR, PROTOCOL_ERROR})
#: Error reset or no error: an earlier emergency is over.
NO_LONGER: Final = 0x0000
#: Code assigned to a message that is too short to contain one.
UNKNOWN_CODE: Final = -1

_WORDS: Final = {
    0x2310: "over-current",
    0x2320: "short circuit",
    0x2330: "leakage to earth",
    0x2340: "short circuit of the motor",
    0x3110: "mains over-voltage",
    0x3120: "mains under-voltage",
    0x3130: "mains phase missing",
    0x3210: "DC link over-voltage",
    0x3220: "DC link under-voltage",
    0x4210: "over-temperature of the drive",
    0x4310: "over-temperature of the motor",
    0x5112: "logic supply too low",
    0x7121: "motor blocked",
    0x7305: "motor encoder",
    0x7306: "second encoder",
    0x8110: "CAN overrun, frames lost",
    0x8120: "CAN error-passive",
    0x8130: "heartbeat of the master lost",
    0x8140: "recovered from bus-off",
    0x8150: "COB-ID used twice",
    0x8210: "PDO too short",
    0x8220: "PDO too long",
    0x8611: "following error",
}

# Error classes by leading digits, for codes that are not in the table.
_KINDS: Final = (
    (0xFF00, 0x2100, "current, input side"),
    (0xFF00, 0x2200, "current inside the drive"),
    (0xFF00, 0x2300, "current, output side"),
    (0xF000, 0x2000, "current"),
    (0xFF00, 0x3100, "mains voltage"),
    (0xFF00, 0x3200, "DC link voltage"),
    (0xFF00, 0x3300, "output voltage"),
    (0xF000, 0x3000, "voltage"),
    (0xFF00, 0x4100, "ambient temperature"),
    (0xFF00, 0x4200, "temperature of the drive"),
    (0xFF00, 0x4300, "temperature of the motor"),
    (0xF000, 0x4000, "temperature"),
    (0xF000, 0x5000, "hardware of the drive"),
    (0xF000, 0x6000, "software of the drive"),
    (0xFF00, 0x7300, "a sensor"),
    (0xF000, 0x7000, "a module of the drive"),
    (0xFF00, 0x8100, "communication"),
    (0xFF00, 0x8200, "protocol"),
    (0xFF00, 0x8300, "torque control"),
    (0xFF00, 0x8400, "velocity control"),
    (0xFF00, 0x8500, "position control"),
    (0xF000, 0x8000, "monitoring"),
    (0xF000, 0x9000, "an external error"),
    (0xFF00, 0xFF00, "specific to the drive, see its manual"),
    (0xF000, 0xF000, "additional function"),
    (0xF000, 0x1000, "generic error"),
    (0xFF00, 0x0000, "no longer"),
)


def emergency_words(code: int) -> str:
    """Text for an error code (0x603F); empty if no standard defines it."""
    if words := _WORDS.get(code):
        return words
    return next((words for mask, kind, words in _KINDS if code & mask == kind), "")
