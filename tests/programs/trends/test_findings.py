"""Findings from day records: what is named, on which joint, and what is not."""

from datetime import date, timedelta

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from programs.trends.day import Day, JointDay, Sum
from programs.trends.findings import health, warnings

FIRST = date(2026, 6, 3)


def joint(
    friction: float = 1.0, gap: float = 0.01, remainder: float = 0.0,
    skew_ms: float = 1.2, bound_s: float = 0.0,
) -> JointDay:  # fmt: skip
    made = JointDay(moved_s=600.0, bound_s=bound_s)
    made.friction.put(friction, 300.0)
    made.half_gap.put(gap, 5.0)
    made.skew_ms.put(skew_ms, 5.0)
    made.forth.put(0.2 + remainder, 200.0)
    made.back.put(-0.2 + remainder, 200.0)
    return made


def days(count: int, elbow, rng: np.random.Generator | None = None, **more: object) -> list[Day]:
    rng = rng or np.random.default_rng(1)
    return [
        Day(
            arm="arm",
            date=(FIRST + timedelta(days=k)).isoformat(),
            joints={
                "shoulder": joint(friction=1.0 + 0.01 * rng.normal()),
                "LElbowRoll": elbow(k, rng),
            },
            **more,
        )
        for k in range(count)
    ]


def worn(k: int, rng: np.random.Generator) -> JointDay:
    return joint(1.0 + 0.022 * k + 0.01 * rng.normal(), 0.004 + 1.1e-4 * k + 5e-5 * rng.normal())


def test_a_gear_that_wears_is_named_with_what_to_do() -> None:
    found = days(11, worn)
    (said,) = warnings(found)
    assert said.startswith("LElbowRoll: friction +2")
    assert "gap +1.1 mrad since 3 June: identify again; grease or wear" in said
    assert [one.joint for one in health(found) if one.named] == ["LElbowRoll"]


@pytest.mark.parametrize(
    ("elbow", "words"),
    [
        (lambda k, r: joint(friction=1.0 + 0.02 * r.normal()), ""),
        (lambda k, r: joint(friction=1.0 + 0.004 * k), ""),  # too small to be named
        (lambda k, r: joint(gap=0.003 + 2e-4 * r.normal()), ""),
        (lambda k, r: joint(friction=1.4 - 0.03 * k), "friction -"),
        (lambda k, r: joint(friction=1.8 + 0.02 * k), "bound of learning in 10 days"),
        (lambda k, r: joint(remainder=0.05 * k), "gravity's remainder +0.50 Nm"),
        (lambda k, r: joint(skew_ms=1.2 + 0.2 * k), "encoder skew +2.0 ms"),
        (lambda k, r: joint(friction=2.2, bound_s=400.0), "at its bound, for 400 of the last"),
        (lambda k, r: joint(friction=1.0, bound_s=20.0), ""),
    ],
)
def test_words_of_findings(elbow, words: str) -> None:
    said = warnings(days(11, elbow))
    assert [bool(words)] == [bool(said)] if words else not said
    assert words in "".join(said)


def test_few_days_give_no_finding_and_an_identification_begins_anew() -> None:
    assert not warnings(days(4, worn))
    assert warnings(days(9, worn))
    again = days(11, worn, identified={"LElbowRoll": "2026-06-11T10:00:00+00:00"})
    assert not warnings(again)
    assert {one.joint: one.identified for one in health(again)}["LElbowRoll"] == "2026-06-11"
    assert health([]) == ()


def test_arms_that_do_not_age_are_seldom_named() -> None:
    """Noise alone: findings on fewer than 2 % of 200 arms over 30 days, looked at every day."""
    named = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        whole = days(30, lambda k, r: joint(1.0 + 0.03 * r.normal(), 0.01 + 2e-4 * r.normal()), rng)
        named += any(warnings(whole[:m]) for m in (5, 8, 12, 20, 30))
    assert named < 4


AMOUNT = st.floats(0.0, 1e15) | st.sampled_from([0.0, 1e-300, 1e15])
TOTAL = st.floats(-1e15, 1e15)
SUM = st.builds(Sum, weight=AMOUNT, first=TOTAL, second=AMOUNT)
JOINT = st.builds(
    JointDay, moved_s=AMOUNT, friction=SUM, half_gap=SUM, skew_ms=SUM, forth=SUM, back=SUM,
    bound_s=AMOUNT,
)  # fmt: skip
DATE = st.dates().map(date.isoformat)
NAME = st.sampled_from(["a", "b", "c", ""])
DAY = st.builds(
    Day, arm=st.text(), date=DATE, joints=st.dictionaries(NAME, JOINT),
    identified=st.dictionaries(NAME, DATE | st.text()),
)  # fmt: skip
NEAR = st.lists(JOINT, min_size=5, max_size=9).map(lambda joints: [
    Day(arm="arm", date=(FIRST + timedelta(days=k)).isoformat(), joints={"a": joint})
    for k, joint in enumerate(joints)
])  # fmt: skip


@given(st.lists(DAY, max_size=8, unique_by=lambda day: day.date) | NEAR)
def test_whatever_files_hold_there_is_an_answer(records: list[Day]) -> None:
    """Anything that can be read, as days in order."""
    records = sorted(records, key=lambda day: day.date)
    read = [msgspec.json.decode(msgspec.json.encode(day), type=Day) for day in records]
    assert read == records
    for one in health(read):
        assert "nan" not in one.words
        msgspec.json.encode(one)
    assert len(warnings(read)) <= len(health(read))
