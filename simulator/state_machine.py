"""CiA 402 power state machine as two tables: commands of a controlword, and transitions."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from types import MappingProxyType


class State(Enum):
    """States of CiA 402 part 2; the values are the state bits of the statusword."""

    NOT_READY_TO_SWITCH_ON = 0x0000
    SWITCH_ON_DISABLED = 0x0040
    READY_TO_SWITCH_ON = 0x0021
    SWITCHED_ON = 0x0023
    OPERATION_ENABLED = 0x0027
    QUICK_STOP_ACTIVE = 0x0007
    FAULT_REACTION_ACTIVE = 0x000F
    FAULT = 0x0008


class Trigger(Enum):
    """Commands of the controlword, and internal events of the drive."""

    SHUTDOWN = "shutdown"
    SWITCH_ON = "switch on"
    ENABLE_OPERATION = "enable operation"
    DISABLE_VOLTAGE = "disable voltage"
    QUICK_STOP = "quick stop"
    FAULT_RESET = "fault reset"
    INITIALISED = "initialised"
    QUICK_STOP_DONE = "quick stop done"
    FAULT_DETECTED = "fault detected"
    REACTION_DONE = "fault reaction done"


@dataclass(frozen=True, slots=True)
class Transition:
    """Transition: its number in CiA 402 and its target state."""

    number: int
    target: State


HOLDING_OPTIONS = frozenset({5, 6, 7, 8})
"""Values of 605A with which the drive stays in quick stop active; transition 16 leads back."""

CONTROLWORD_MASKS: tuple[tuple[int, int, Trigger], ...] = (
    (0x02, 0x00, Trigger.DISABLE_VOLTAGE),
    (0x06, 0x02, Trigger.QUICK_STOP),
    (0x07, 0x06, Trigger.SHUTDOWN),
    (0x0F, 0x07, Trigger.SWITCH_ON),
    (0x0F, 0x0F, Trigger.ENABLE_OPERATION),
)
"""Rows (mask, value, command); every controlword matches exactly one."""

_S, _E = State, Trigger
TRANSITIONS: Mapping[tuple[State, Trigger], Transition] = MappingProxyType(
    {
        (_S.NOT_READY_TO_SWITCH_ON, _E.INITIALISED): Transition(1, _S.SWITCH_ON_DISABLED),
        (_S.SWITCH_ON_DISABLED, _E.SHUTDOWN): Transition(2, _S.READY_TO_SWITCH_ON),
        (_S.READY_TO_SWITCH_ON, _E.SWITCH_ON): Transition(3, _S.SWITCHED_ON),
        # Enable operation in this state passes through switched on automatically (3, then 4).
        (_S.READY_TO_SWITCH_ON, _E.ENABLE_OPERATION): Transition(3, _S.SWITCHED_ON),
        (_S.SWITCHED_ON, _E.ENABLE_OPERATION): Transition(4, _S.OPERATION_ENABLED),
        (_S.OPERATION_ENABLED, _E.SWITCH_ON): Transition(5, _S.SWITCHED_ON),
        (_S.SWITCHED_ON, _E.SHUTDOWN): Transition(6, _S.READY_TO_SWITCH_ON),
        (_S.READY_TO_SWITCH_ON, _E.DISABLE_VOLTAGE): Transition(7, _S.SWITCH_ON_DISABLED),
        (_S.READY_TO_SWITCH_ON, _E.QUICK_STOP): Transition(7, _S.SWITCH_ON_DISABLED),
        (_S.OPERATION_ENABLED, _E.SHUTDOWN): Transition(8, _S.READY_TO_SWITCH_ON),
        (_S.OPERATION_ENABLED, _E.DISABLE_VOLTAGE): Transition(9, _S.SWITCH_ON_DISABLED),
        (_S.SWITCHED_ON, _E.DISABLE_VOLTAGE): Transition(10, _S.SWITCH_ON_DISABLED),
        (_S.SWITCHED_ON, _E.QUICK_STOP): Transition(10, _S.SWITCH_ON_DISABLED),
        (_S.OPERATION_ENABLED, _E.QUICK_STOP): Transition(11, _S.QUICK_STOP_ACTIVE),
        (_S.QUICK_STOP_ACTIVE, _E.DISABLE_VOLTAGE): Transition(12, _S.SWITCH_ON_DISABLED),
        (_S.QUICK_STOP_ACTIVE, _E.QUICK_STOP_DONE): Transition(12, _S.SWITCH_ON_DISABLED),
        **{
            (state, _E.FAULT_DETECTED): Transition(13, _S.FAULT_REACTION_ACTIVE)
            for state in _S
            if state not in (_S.FAULT_REACTION_ACTIVE, _S.FAULT)
        },
        (_S.FAULT_REACTION_ACTIVE, _E.REACTION_DONE): Transition(14, _S.FAULT),
        (_S.FAULT, _E.FAULT_RESET): Transition(15, _S.SWITCH_ON_DISABLED),
        (_S.QUICK_STOP_ACTIVE, _E.ENABLE_OPERATION): Transition(16, _S.OPERATION_ENABLED),
    }
)


def command(controlword: int) -> Trigger:
    """Command in bits 0 to 3 of a controlword."""
    return next(event for mask, value, event in CONTROLWORD_MASKS if controlword & mask == value)


def step(state: State, event: Trigger, quick_stop_option: int = 6) -> State:
    """State after one event; unchanged if the table has no such transition.

    quick_stop_option: value of 605A; quick stop done (12) needs an option that does not hold, the
    way back (16) one that does.
    """
    transition = TRANSITIONS.get((state, event))
    if transition is None:
        return state
    if state is State.QUICK_STOP_ACTIVE and event is not Trigger.DISABLE_VOLTAGE:
        holds = quick_stop_option in HOLDING_OPTIONS
        if event in (Trigger.QUICK_STOP_DONE, Trigger.ENABLE_OPERATION) and (
            holds is (event is Trigger.QUICK_STOP_DONE)
        ):
            return state
    return transition.target


@lru_cache(maxsize=1024)  # called by every drive in every tick, mostly with the same arguments
def on_controlword(state: State, previous: int, controlword: int, quick_stop_option: int) -> State:
    """State after a controlword: fault reset on the rising edge of bit 7, else its command."""
    if controlword & ~previous & 0x80:
        after = step(state, Trigger.FAULT_RESET, quick_stop_option)
        if after is not state:
            return after
    asked = command(controlword)
    after = step(state, asked, quick_stop_option)
    if state is State.READY_TO_SWITCH_ON and asked is Trigger.ENABLE_OPERATION:
        after = step(after, asked, quick_stop_option)
    return after
