"""Rules of sensing: each can be broken, and what is right breaks none."""

from typing import Any

import pytest

from daemon.protocol.state import Notice, State
from tests.bench.soak.scenes import C, broken_by, first, notices, state

N = len(C.joints)
QUIET = round(C.admittance.quiet_s / C.period_s)  # ticks
NOT_SENSING = [False] + [True] * (N - 1)


def at(tick: int, *, senses: bool = True, **changes: Any) -> State:
    return state(tick, sensing=[True] * N if senses else NOT_SENSING, **changes)


def moved(before: str, after: str) -> list[Notice]:
    return notices(f"{before} -> {after}: why")


def deaf_for(ticks: int, mode: str) -> list[State]:
    """Nothing is said of how the mode began, which is no matter of these rules."""
    return [at(k, mode=mode, senses=k > ticks) for k in range(1, ticks + 3)]


def led(pattern: str, after: str, before: str = "admittance") -> list[State]:
    """Admittance whose ticks are felt to be quiet (.), touched (t), or not felt (x); and then."""
    states = [at(1, mode=before, thresholded=first(1.0))]
    quiet_s = 0.0
    for k, tick in enumerate(pattern, start=2):
        quiet_s = {".": quiet_s + 0.01, "x": quiet_s, "t": 0.0}[tick]
        felt = first(1.0 if tick == "t" else 0.0)
        states.append(at(k, mode=before, senses=tick != "x", thresholded=felt, quiet_s=quiet_s))
    end = len(pattern) + 2
    return [*states, at(end, mode=after, notices=moved(before, after), quiet_s=quiet_s + 0.01)]


MOVES, TIME, GOES_ON = (
    "no motion without sensing",
    "no quiet time without sensing",
    "the arm goes on after a time that was felt to be quiet",
)
LAST = QUIET - 1  # the tick in which it goes on is quiet, too
BROKEN: list[tuple[str, list[State]]] = [
    (MOVES, deaf_for(6, "tracking")),
    (MOVES, deaf_for(6, "admittance")),
    (MOVES, deaf_for(6, "retracting")),
    (MOVES, deaf_for(6, "returning")),
    (MOVES, deaf_for(6, "releasing")),
    (TIME, [at(1, quiet_s=1.0), at(2, quiet_s=1.01, senses=False)]),
    (GOES_ON, led("." * (LAST - 1), "tracking")),
    (GOES_ON, led("." * (LAST - 1), "returning")),
    (GOES_ON, led("." * (LAST - 1), "tracking", before="retracting")),
    (GOES_ON, led("xx" + "." * (LAST - 2), "tracking")),
    (GOES_ON, led("." * LAST + "t" + "." * (LAST - 1), "tracking")),
]
KEPT: dict[str, list[State]] = {
    "deaf for a moment": deaf_for(5, "tracking"),
    "deaf now and then": [at(k, mode="tracking", senses=k % 6 == 0) for k in range(1, 100)],
    "deaf, and it holds": deaf_for(20, "holding"),
    "deaf, and it stops": deaf_for(20, "stopping"),
    "deaf while it is off, and not when it moves": [
        *(state(k, mode="off", sensing=NOT_SENSING) for k in range(1, 20)),
        *(state(k, mode="off", sensing=[True] * N) for k in (20, 21)),
    ],
    "format 1": [state(k, mode="tracking") for k in range(1, 20)],
    "quiet time stands": [at(k, quiet_s=1.0, senses=False) for k in range(1, 4)],
    "quiet time runs": [at(k, quiet_s=0.01 * k) for k in range(1, 4)],
    "it goes on": led("." * LAST, "tracking"),
    "it goes on after a while without": led("." * 9 + "xxx" + "." * (LAST - 9), "tracking"),
    "it goes on after the last touch": led("..t" + "." * LAST, "returning"),
    "it only holds": led(".", "holding"),
}


@pytest.mark.parametrize(("rule", "states"), BROKEN, ids=[rule for rule, _ in BROKEN])
def test_each_rule_of_sensing_can_be_broken(rule: str, states: list[State]) -> None:
    assert broken_by(states) == {rule}


@pytest.mark.parametrize("name", KEPT)
def test_what_is_right_breaks_no_rule_of_sensing(name: str) -> None:
    assert not broken_by(KEPT[name])
