"""Leases: one owner at a time, ended by time or with the connection, never longer than granted."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.protocol.lease import Lease, Owner, in_words

ALICE, BOB = Owner(1000, 7), Owner(1001, 8)
PROGRAM, OTHER = Owner(1000, 9, 3), Owner(1000, 9, 4)

owners = st.builds(Owner, st.integers(0, 2), st.integers(1, 3), st.integers(0, 3))
times = st.floats(0.0, 100.0)


@pytest.mark.parametrize(
    ("owner", "other", "same"),
    [
        (ALICE, replace(ALICE, pid=99), True),  # a person's next command is another process
        (ALICE, BOB, False),
        (PROGRAM, PROGRAM, True),
        (PROGRAM, OTHER, False),  # the same program on another connection
        (PROGRAM, ALICE, False),  # the same user at a command line
        (ALICE, PROGRAM, False),
    ],
)
def test_same_owner(owner: Owner, other: Owner, same: bool) -> None:
    assert owner.is_same(other) is same
    assert bool(Lease(owner, 10.0).refusal(other, 1.0)) is not same


def test_another_is_refused_with_who_and_how_long() -> None:
    words = Lease(ALICE, 560.0).refusal(BOB, 8.0)
    assert words.startswith("armed by uid 1000 (pid 7) for another 9 min 12 s: only this owner can")
    assert "disarm" in words
    assert Lease(ALICE, 560.0).refusal(BOB, 560.0) == ""


def test_why_it_ended() -> None:
    assert Lease(PROGRAM, 5.0).ended(4.99) == ""
    assert Lease(PROGRAM, 5.0).ended(5.0) == "the lease of uid 1000 (pid 9) ran out"
    assert Lease(PROGRAM, 5.0).ended(1.0, 3) == "uid 1000 (pid 9), who had armed it, is gone"
    assert Lease(PROGRAM, 5.0).ended(1.0, 4) == ""


@given(owner=owners, other=owners)
def test_sameness_is_mutual(owner: Owner, other: Owner) -> None:
    assert owner.is_same(owner)
    assert owner.is_same(other) == other.is_same(owner)


@given(owner=owners, until=times, closed=st.integers(0, 3))
def test_a_persons_lease_lives_by_time_alone(owner: Owner, until: float, closed: int) -> None:
    person = replace(owner, connection=0)
    assert Lease(person, until).ended(until - 1e-3, closed) == ""
    assert Lease(person, until).ended(until, closed)


@given(
    asked=st.lists(st.tuples(st.floats(0.0, 5.0), owners, st.floats(0.01, 5.0)), max_size=30),
    gone=st.lists(st.tuples(times, st.integers(1, 3)), max_size=5),
)
def test_an_arm_is_never_armed_longer_than_asked_for(
    asked: list[tuple[float, Owner, float]], gone: list[tuple[float, int]]
) -> None:
    """Played as the service does it, against what was granted and lost."""
    now, held = 0.0, None
    calls = []
    for wait, owner, duration in asked:
        now += wait
        calls.append((now, owner, duration))
    for moment, closed in gone:
        calls.append((moment, Owner(0, 0, closed), 0.0))
    for moment, owner, duration in sorted(calls, key=lambda call: call[0]):
        if held and held.ended(moment, 0 if duration else owner.connection):
            held = None
        if duration == 0.0:
            assert held is None or held.owner.connection != owner.connection
            continue
        refusal = held.refusal(owner, moment) if held else ""
        if refusal:
            assert held is not None
            assert not held.owner.is_same(owner)
            assert str(held.owner) in refusal
        else:
            assert held is None or held.owner.is_same(owner)
            held = Lease(owner, moment + duration)
        assert held is not None
        assert moment < held.until_s


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.5, "0.5 s"), (42.0, "42 s"), (60.0, "1 min"), (552.4, "9 min 12 s"), (86_400, "1440 min")],
)
def test_in_words(seconds: float, words: str) -> None:
    assert in_words(seconds) == words
