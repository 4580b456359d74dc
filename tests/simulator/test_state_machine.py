"""Every row of the CiA 402 table, and nothing but the rows."""

import itertools

import pytest

from simulator.state_machine import TRANSITIONS, State, Trigger, command, on_controlword, step

S, E = State, Trigger
COMMANDS = {
    0x00: E.DISABLE_VOLTAGE,
    0x0D: E.DISABLE_VOLTAGE,
    0x02: E.QUICK_STOP,
    0x0B: E.QUICK_STOP,
    0x06: E.SHUTDOWN,
    0x0E: E.SHUTDOWN,
    0x07: E.SWITCH_ON,
    0x0F: E.ENABLE_OPERATION,
    0x1F: E.ENABLE_OPERATION,
}
# As printed in the standard: (number, from, controlword, to). 605A = 6.
BY_CONTROLWORD = [
    (2, S.SWITCH_ON_DISABLED, 0x06, S.READY_TO_SWITCH_ON),
    (3, S.READY_TO_SWITCH_ON, 0x07, S.SWITCHED_ON),
    (4, S.SWITCHED_ON, 0x0F, S.OPERATION_ENABLED),
    (5, S.OPERATION_ENABLED, 0x07, S.SWITCHED_ON),
    (6, S.SWITCHED_ON, 0x06, S.READY_TO_SWITCH_ON),
    (7, S.READY_TO_SWITCH_ON, 0x00, S.SWITCH_ON_DISABLED),
    (7, S.READY_TO_SWITCH_ON, 0x02, S.SWITCH_ON_DISABLED),
    (8, S.OPERATION_ENABLED, 0x06, S.READY_TO_SWITCH_ON),
    (9, S.OPERATION_ENABLED, 0x00, S.SWITCH_ON_DISABLED),
    (10, S.SWITCHED_ON, 0x00, S.SWITCH_ON_DISABLED),
    (10, S.SWITCHED_ON, 0x02, S.SWITCH_ON_DISABLED),
    (11, S.OPERATION_ENABLED, 0x02, S.QUICK_STOP_ACTIVE),
    (12, S.QUICK_STOP_ACTIVE, 0x00, S.SWITCH_ON_DISABLED),
    (15, S.FAULT, 0x80, S.SWITCH_ON_DISABLED),
    (16, S.QUICK_STOP_ACTIVE, 0x0F, S.OPERATION_ENABLED),
]


@pytest.mark.parametrize(("word", "event"), COMMANDS.items())
def test_command_of_a_controlword(word: int, event: Trigger) -> None:
    assert command(word) is event


def test_every_controlword_is_one_command() -> None:
    for word in range(0x10):
        assert command(word) is command(word | 0xFF70)


@pytest.mark.parametrize(("number", "state", "word", "target"), BY_CONTROLWORD)
def test_row(number: int, state: State, word: int, target: State) -> None:
    assert on_controlword(state, 0x00, word, quick_stop_option=6) is target
    event = Trigger.FAULT_RESET if word & 0x80 else command(word)
    assert TRANSITIONS[state, event].number == number


def test_no_other_controlword_leads_anywhere() -> None:
    leads = {(state, command(word)): target for _, state, word, target in BY_CONTROLWORD}
    # Enable operation in ready to switch on runs through transitions 3 and 4 at once.
    leads[S.READY_TO_SWITCH_ON, E.ENABLE_OPERATION] = S.OPERATION_ENABLED
    leads.pop((S.FAULT, E.DISABLE_VOLTAGE))
    for state, word in itertools.product(S, (0x00, 0x02, 0x06, 0x07, 0x0F)):
        expected = leads.get((state, command(word)), state)
        assert on_controlword(state, 0x00, word, quick_stop_option=6) is expected, (state, word)


def test_fault_reset_needs_a_rising_edge_and_a_fault() -> None:
    assert on_controlword(S.FAULT, 0x80, 0x80, 6) is S.FAULT
    assert on_controlword(S.FAULT, 0x00, 0x80, 6) is S.SWITCH_ON_DISABLED
    assert on_controlword(S.FAULT_REACTION_ACTIVE, 0x00, 0x80, 6) is S.FAULT_REACTION_ACTIVE
    assert on_controlword(S.OPERATION_ENABLED, 0x0F, 0x8F, 6) is S.OPERATION_ENABLED


@pytest.mark.parametrize("option", [0, 1, 2, 3, 5, 6, 7, 8])
def test_quick_stop_option_decides_between_12_and_16(option: int) -> None:
    holds = option >= 5
    done = step(S.QUICK_STOP_ACTIVE, E.QUICK_STOP_DONE, option)
    back = step(S.QUICK_STOP_ACTIVE, E.ENABLE_OPERATION, option)
    assert done is (S.QUICK_STOP_ACTIVE if holds else S.SWITCH_ON_DISABLED)
    assert back is (S.OPERATION_ENABLED if holds else S.QUICK_STOP_ACTIVE)
    assert step(S.QUICK_STOP_ACTIVE, E.DISABLE_VOLTAGE, option) is S.SWITCH_ON_DISABLED
    assert step(S.QUICK_STOP_ACTIVE, E.FAULT_DETECTED, option) is S.FAULT_REACTION_ACTIVE


@pytest.mark.parametrize("state", [s for s in S if s not in (S.FAULT, S.FAULT_REACTION_ACTIVE)])
def test_a_fault_is_possible_everywhere(state: State) -> None:
    reacting = step(state, E.FAULT_DETECTED)
    assert reacting is S.FAULT_REACTION_ACTIVE
    assert step(reacting, E.REACTION_DONE) is S.FAULT
    assert TRANSITIONS[state, E.FAULT_DETECTED].number == 13


def test_numbers_are_those_of_the_standard() -> None:
    assert {t.number for t in TRANSITIONS.values()} == set(range(1, 17))
    assert step(S.NOT_READY_TO_SWITCH_ON, E.INITIALISED) is S.SWITCH_ON_DISABLED
