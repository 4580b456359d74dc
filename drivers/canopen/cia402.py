"""CiA 402 power state machine as tables (IEC 61800-7-201): statusword -> state -> controlword.

Nothing here blocks: each tick maps one statusword to one controlword. The tables are complete.
"""

from enum import IntEnum
from functools import lru_cache
from typing import Final

from drivers.api import DriveCondition, DriveStatus, PowerTarget


class DriveState(IntEnum):
    """State of the drive's power state machine; UNKNOWN is a statusword outside the standard."""

    UNKNOWN = 0
    NOT_READY_TO_SWITCH_ON = 1
    SWITCH_ON_DISABLED = 2
    READY_TO_SWITCH_ON = 3
    SWITCHED_ON = 4
    OPERATION_ENABLED = 5
    QUICK_STOP_ACTIVE = 6
    FAULT_REACTION_ACTIVE = 7
    FAULT = 8


# (mask, value, state): statusword & mask == value.
STATUSWORD_TABLE: Final = (
    (0x4F, 0x00, DriveState.NOT_READY_TO_SWITCH_ON),
    (0x4F, 0x40, DriveState.SWITCH_ON_DISABLED),
    (0x6F, 0x21, DriveState.READY_TO_SWITCH_ON),
    (0x6F, 0x23, DriveState.SWITCHED_ON),
    (0x6F, 0x27, DriveState.OPERATION_ENABLED),
    (0x6F, 0x07, DriveState.QUICK_STOP_ACTIVE),
    (0x4F, 0x0F, DriveState.FAULT_REACTION_ACTIVE),
    (0x4F, 0x08, DriveState.FAULT),
)

#: Statusword bits beyond the state: the power stage has voltage, in any state; the drive follows
#: the command value (in cyclic synchronous velocity mode). Not every drive implements them.
VOLTAGE_ENABLED: Final = 1 << 4
FOLLOWS: Final = 1 << 12

DISABLE_VOLTAGE: Final = 0x0000
QUICK_STOP: Final = 0x0002
SHUTDOWN: Final = 0x0006
SWITCH_ON: Final = 0x0007
ENABLE_OPERATION: Final = 0x000F
FAULT_RESET: Final = 0x0080

_S = DriveState

# Rows are states, columns are targets. A single statusword may be wrong, so every controlword is
# harmless in states other than the reported one: quick stop changes nothing in an unpowered drive
# (CiA 402, transitions 7 and 10), starts a ramp in operation (11), and does nothing in a fault; bit
# 7 stays clear, so that a reset has a rising edge. OFF is for drives at standstill, and no other
# target removes power.
CONTROLWORD_TABLE: Final = {
    #                            OFF              ON                QUICK_STOP
    _S.UNKNOWN:                (DISABLE_VOLTAGE, QUICK_STOP,       QUICK_STOP),
    _S.NOT_READY_TO_SWITCH_ON: (DISABLE_VOLTAGE, QUICK_STOP,       QUICK_STOP),
    _S.SWITCH_ON_DISABLED:     (DISABLE_VOLTAGE, SHUTDOWN,         QUICK_STOP),
    _S.READY_TO_SWITCH_ON:     (DISABLE_VOLTAGE, SWITCH_ON,        QUICK_STOP),
    _S.SWITCHED_ON:            (DISABLE_VOLTAGE, ENABLE_OPERATION, QUICK_STOP),
    _S.OPERATION_ENABLED:      (DISABLE_VOLTAGE, ENABLE_OPERATION, QUICK_STOP),
    _S.QUICK_STOP_ACTIVE:      (DISABLE_VOLTAGE, ENABLE_OPERATION, QUICK_STOP),
    _S.FAULT_REACTION_ACTIVE:  (DISABLE_VOLTAGE, QUICK_STOP,       QUICK_STOP),
    _S.FAULT:                  (DISABLE_VOLTAGE, QUICK_STOP,       QUICK_STOP),
}  # fmt: skip

# Towards ON, these remove power from a drive that is already in operation (transitions 8, 5).
_TAKES_POWER: Final = frozenset({SHUTDOWN, SWITCH_ON})

# States without motor torque, in which quick stop has no further effect.
UNPOWERED: Final = frozenset(
    {
        _S.NOT_READY_TO_SWITCH_ON,
        _S.SWITCH_ON_DISABLED,
        _S.READY_TO_SWITCH_ON,
        _S.SWITCHED_ON,
        _S.FAULT,
    }
)

_C = DriveCondition

CONDITION_OF: Final = {
    _S.UNKNOWN: _C.UNKNOWN,
    _S.NOT_READY_TO_SWITCH_ON: _C.OFF,
    _S.SWITCH_ON_DISABLED: _C.OFF,
    _S.READY_TO_SWITCH_ON: _C.OFF,
    _S.SWITCHED_ON: _C.STANDBY,
    _S.OPERATION_ENABLED: _C.OPERATING,
    _S.QUICK_STOP_ACTIVE: _C.STOPPED,
    _S.FAULT_REACTION_ACTIVE: _C.FAILING,
    _S.FAULT: _C.FAILED,
}

# Statuswords of a drive differ in few bits; this cache holds all that occur in practice.
_STATUSES_KEPT: Final = 512


def _classify(statusword: int) -> DriveState:
    for mask, value, state in STATUSWORD_TABLE:
        if statusword & mask == value:
            return state
    return DriveState.UNKNOWN


# Only bits 0-3, 5 and 6 encode the state, so 112 entries cover all 65 536 statuswords.
_STATES: Final = tuple(_classify(bits) for bits in range(0x6F + 1))


def drive_state(statusword: int) -> DriveState:
    """State encoded in a statusword (0x6041); the other bits are ignored."""
    return _STATES[statusword & 0x6F]


def state_name(state: DriveState) -> str:
    """Name of a state: `switch on disabled`."""
    return state.name.lower().replace("_", " ")


def in_words(statusword: int) -> str:
    """Statusword as text: `switch on disabled (statusword 0x0250)`; negative: none received yet."""
    if statusword < 0:
        return "no reported state"
    return f"{state_name(drive_state(statusword))} (statusword 0x{statusword:04X})"


@lru_cache(_STATUSES_KEPT)
def drive_status(statusword: int) -> DriveStatus:
    """Status of a drive for the daemon, from its statusword; negative: none received yet."""
    state = drive_state(statusword)
    none = statusword < 0
    return DriveStatus(
        condition=CONDITION_OF[state],
        state=state_name(state),
        detail=in_words(statusword),
        supplied=None if none else bool(statusword & VOLTAGE_ENABLED),
        following=not none and bool(statusword & FOLLOWS),
    )


def controlword(
    state: DriveState, target: PowerTarget, previous: int = 0, reset: bool = False
) -> int:
    """Next controlword (0x6040) from `state` towards `target`.

    A fault is left only on request (`reset`), by a rising edge of bit 7: `previous`, the last
    controlword sent, determines which half of the edge comes now, so that a reset requested for
    several ticks gives an edge every other tick. If `previous` enabled operation but the drive
    reports another state, it gets one quick stop in between: power-up begins with the next
    statusword, so that a single wrong one does no harm.
    """
    if reset and state is DriveState.FAULT:
        return DISABLE_VOLTAGE if previous & FAULT_RESET else FAULT_RESET
    word = CONTROLWORD_TABLE[state][target]
    return QUICK_STOP if previous == ENABLE_OPERATION and word in _TAKES_POWER else word
