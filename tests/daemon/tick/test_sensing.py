"""Watch on the sensing of contact, and its notices."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.protocol.state import Notice
from daemon.tick.sensing import AGAIN_S, SETTLED, Sensing, SensingNotices
from estimator.estimate import Estimate, Flag

T = 0.01
GAIN = 38.0  # [1/s]: a residual that began anew has settled after 0.105 s
NAMES = ("shoulder", "elbow")
NO_FLAG = Flag(0)
ALL, NONE, ELBOW = "..", "xx", ".x"  # which joints sense, no elbow is an x


def estimate(sensing: str, flags: Flag) -> Estimate:
    zero = np.zeros(len(sensing))
    return Estimate(
        q=zero, q_dot=zero, theta=zero, phi=zero, phi_sigma=zero, side=zero.astype(np.int8),
        tau_M=zero, residual=zero, beside={}, threshold=zero, thresholded=zero,
        level_share=zero, uncorrected=zero, contacts=(),
        touched_link="", flags=flags, wrench=zero,
        sensing=np.array([each == "." for each in sensing]),
    )  # fmt: skip


@dataclass
class Reported:
    """Sensing after ticks of estimates."""

    sensing: Sensing = field(default_factory=lambda: Sensing(len(NAMES), GAIN))
    tick: int = 0

    def step(self, sensing: str | None, ticks: int = 1, flags: Flag = NO_FLAG) -> "Reported":
        for _ in range(ticks):
            self.tick += 1
            now = None if sensing is None else estimate(sensing, flags)
            self.sensing.step(T * self.tick, now)
        return self

    @property
    def since(self) -> list[int]:
        """In ticks."""
        return [round(since_s / T) for since_s in self.sensing.since_s]


# Ticks of what sensed, and then: which joints sense, and since which tick.
CHANGES: dict[str, tuple[list[tuple[str | None, int]], str, list[int]]] = {
    "nothing before the first estimate": ([(None, 5)], NONE, [0, 0]),
    "since the first": ([(None, 5), (ALL, 3)], ALL, [6, 6]),
    "one joint loses it": ([(ALL, 3), (ELBOW, 4)], ELBOW, [1, 4]),
    "and has it again": ([(ALL, 3), (ELBOW, 4), (ALL, 2)], ALL, [1, 8]),
    "each for itself": ([(ALL, 3), (ELBOW, 4), (NONE, 2)], NONE, [8, 4]),
    "no estimate changes nothing": ([(ALL, 3), (None, 4)], ALL, [1, 1]),
}


@pytest.mark.parametrize("name", CHANGES)
def test_which_joints_sense_and_since_when(name: str) -> None:
    story, joints, since = CHANGES[name]
    reported = Reported()
    for sensing, ticks in story:
        reported.step(sensing, ticks)
    assert reported.sensing.joints.tolist() == [each == "." for each in joints]
    assert reported.since == since


SETTLING = int(SETTLED / GAIN / T)  # ticks
# Flags of one tick, and for how many ticks after it the sensing is not sure.
UNSURE: dict[str, tuple[Flag, int]] = {
    "nothing is flagged": (Flag(0), 0),
    "late": (Flag.LATE, 0),
    "bridged": (Flag.BRIDGED, 0),
    "late and bridged": (Flag.LATE | Flag.BRIDGED, 0),
    "not a number": (Flag.INVALID, SETTLING),
    "restarted": (Flag.RESTARTED, SETTLING),
    "starting": (Flag.STARTING, SETTLING),
    "late and restarted": (Flag.LATE | Flag.RESTARTED, SETTLING),
}


@pytest.mark.parametrize("name", UNSURE)
def test_sensing_is_sure_once_the_residual_has_settled(name: str) -> None:
    flags, unsure = UNSURE[name]
    reported = Reported().step(ALL, 100)
    sure = [reported.step(ALL, flags=flags).sensing.sure]
    sure += [reported.step(ALL).sensing.sure for _ in range(3 * SETTLING)]
    assert sure.count(False) == (unsure + 1 if unsure else 0)
    assert sure == sorted(sure), "not at once"


def test_raised_levels_are_settled_and_not_sure() -> None:
    """A level raised for missing samples may hide a hand: nothing is quiet by it."""
    reported = Reported().step(ALL, 30)
    assert reported.sensing.sure
    reported.step(ALL, 1, Flag.LATE | Flag.RAISED)
    for _ in range(20):
        assert (reported.sensing.settled, reported.sensing.sure) == (True, False)
        reported.step(ALL)
    reported.step(ALL, 14)
    assert reported.sensing.sure


def test_sure_needs_every_joint() -> None:
    reported = Reported().step(ALL, 100)
    assert reported.sensing.sure
    assert not reported.step(ELBOW).sensing.sure
    assert reported.step(ALL).sensing.sure, "what was bridged needs no time to settle"
    assert not Reported().step(None, 100).sensing.sure


def test_residuals_that_begin_at_zero_are_unsettled_and_sense_from_then_on() -> None:
    reported = Reported().step(ALL, 100)
    reported.sensing.begin_anew(T * reported.tick)
    assert reported.since == [100, 100]
    sure = [reported.sensing.sure] + [reported.step(ALL).sensing.sure for _ in range(2 * SETTLING)]
    assert sure.count(False) == SETTLING + 1
    assert reported.sensing.joints.all()


# --- news -----------------------------------------------------------------------------------------

AGAIN = round(AGAIN_S / T)


def news(*story: tuple[str, int]) -> list[tuple[int, Notice]]:
    """Notices of ticks (what senses, how many): not sensing is found from its third tick on."""
    reported, made, lost = Reported().step(ALL, 10), SensingNotices(NAMES), 0
    found = []
    for sensing, ticks in story:
        for _ in range(ticks):
            reported.step(sensing)
            lost = 0 if sensing == ALL else lost + 1
            names = ", ".join(n for n, s in zip(NAMES, sensing, strict=True) if s == "x")
            findings = (Finding(Condition.LATE), Finding(Condition.NOT_SENSING, names))
            these = findings if lost >= 3 else findings[:1]
            notices = made.step(T * reported.tick, reported.sensing, these)
            found += [(reported.tick, notice) for notice in notices]
    return found


LOST, BACK = "not sensing contact", f"sensing contact again for {AGAIN_S:g} s"
NEWS: dict[str, tuple[list[tuple[str, int]], list[tuple[int, str]]]] = {
    "nothing lost, nothing reported": ([(ALL, 200)], []),
    "too short to be found": ([(ELBOW, 2), (ALL, 200)], []),
    "once, and once when it is over": (
        [(ELBOW, 40), (ALL, 200)],
        [(13, f"{LOST}: elbow"), (51 + AGAIN, f"{BACK}: elbow after 0.40 s")],
    ),
    "what comes and goes is reported once": (
        [(ELBOW, 5), (ALL, 5)] * 20 + [(ALL, 100)],
        [(13, f"{LOST}: elbow"), (206 + AGAIN, f"{BACK}: elbow after 1.95 s")],
    ),
    "as long as it lasts": ([(ELBOW, 500)], [(13, f"{LOST}: elbow")]),
    "a second joint is news": (
        [(ELBOW, 10), (NONE, 10), (ALL, 100)],
        [
            (13, f"{LOST}: elbow"),
            (21, f"{LOST}: shoulder, elbow"),
            (31 + AGAIN, f"{BACK}: shoulder after 0.10 s, elbow after 0.20 s"),
        ],
    ),
    "and again": (
        [(ELBOW, 10), (ALL, 100)] * 2,
        [
            (13, f"{LOST}: elbow"),
            (21 + AGAIN, f"{BACK}: elbow after 0.10 s"),
            (123, f"{LOST}: elbow"),
            (131 + AGAIN, f"{BACK}: elbow after 0.10 s"),
        ],
    ),
}


@pytest.mark.parametrize("name", NEWS)
def test_notices_of_joints_that_do_not_sense(name: str) -> None:
    story, expected = NEWS[name]
    found = news(*story)
    assert [(tick, notice.text) for tick, notice in found] == expected
    for _, notice in found:
        assert notice.kind == ("fault" if notice.text.startswith(LOST) else "mode")
