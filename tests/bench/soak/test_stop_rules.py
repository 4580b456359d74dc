"""Rules of stops: each can be broken, and what a stop may do breaks none."""

from typing import Any

import msgspec
import pytest

from daemon.protocol.state import Notice, State
from daemon.tick.notices import STOP_PROVED
from programs.contactd.travels import travels
from tests.bench.soak.scenes import MIDDLE, C, Scene, broken_by, first, ledger_of, notices, state

PROVED = Notice(kind="mode", text=STOP_PROVED)
TRAVEL = travels(C)[0].total


def faulted(tick: int, **changes: Any) -> State:
    return state(tick, **{"mode": "faulted", "cause": "why", **changes})


def fault(tick: int, **changes: Any) -> State:
    return faulted(tick, notices=notices("holding -> faulted: why"), **changes)


def reset(tick: int) -> State:
    return state(tick, mode="off", notices=notices("faulted -> off: reset"))


def again(tick: int, **changes: Any) -> State:
    return faulted(tick, notices=notices("off -> faulted: why"), **changes)


DOUBTED = [state(1), *(fault(2) if k == 2 else faulted(k, unproved=["x"]) for k in range(2, 104))]
MOVES = [state(1), fault(2), faulted(3, notices=[PROVED]), faulted(4)]
MOVES += [faulted(k, motor_velocity=first(0.06)) for k in range(34, 38)]
GOES_ON = [state(1), fault(2), faulted(3, link_position=first(MIDDLE[0] + TRAVEL + 0.01, MIDDLE))]
BROKEN = [
    ("no motion after a proved stop", MOVES),
    ("no joint goes further than is printed", GOES_ON),
    ("a stop is proved or the arm silent", DOUBTED),
    (
        "a stop is proved or the arm silent",  # and no one moves it
        [
            msgspec.structs.replace(s, notices=[PROVED] if s.tick == 3 else s.notices)
            for s in DOUBTED
        ],
    ),
    ("one reset is enough", [faulted(1), reset(2), again(52)]),
]


@pytest.mark.parametrize(("rule", "states"), BROKEN, ids=[rule for rule, _ in BROKEN])
def test_each_rule_of_stops_can_be_broken(rule: str, states: list[State]) -> None:
    assert broken_by(states) == {rule}


KEPT: dict[str, list[Scene]] = {
    "its link falls through its gap": [(each, False, False) for each in MOVES[:-2]],
    "a hand moves it": [(each, each.tick == 4, False) for each in MOVES],
    "a hand drags it": [(each, each.tick == 2, False) for each in GOES_ON],
    "as far as is printed": [
        (each, False, False)
        for each in (*GOES_ON[:2], faulted(3, link_position=first(MIDDLE[0] + TRAVEL, MIDDLE)))
    ],
    "not fresh": [
        (each, False, False)
        for each in (
            *GOES_ON[:2],
            faulted(3, link_position=[9.0] * 7, motor_velocity=[9.0] * 7, fresh=[False] * 7),
        )
    ],
    "it stood, and a hand moves it for long": [
        (msgspec.structs.replace(s, notices=[PROVED] if s.tick == 3 else s.notices), True, False)
        for s in DOUBTED
    ],
    "in time": [(each, False, False) for each in DOUBTED[:-1]],
    "silent": [(msgspec.structs.replace(s, silenced=s.tick > 50), False, False) for s in DOUBTED],
    "suspended": [(state(1), False, False), (fault(2), False, False)]
    + [(faulted(k, unproved=["x"]), False, False) for k in (3, 303, 304)],
    "it holds": [(each, False, False) for each in (faulted(1), reset(2), state(63, mode="off"))],
    "a new cause": [(faulted(1), False, False), (reset(2), False, False), (again(52), False, True)],
}


@pytest.mark.parametrize("name", KEPT)
def test_what_a_stop_may_do_breaks_no_rule(name: str) -> None:
    ledger = ledger_of(KEPT[name])
    assert not ledger.broken, ledger.cases
