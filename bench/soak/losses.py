"""Losses of a soak: samples of a drive, or deadlines, that go missing for seconds, drawn at random.

No fault by itself: an arm may go on as long as it feels every touch, and no longer.
"""

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from random import Random

from bench.rigs.breakable_arm import BreakableArm, Fault
from bench.rigs.faults import Case
from daemon.faults.conditions import Condition
from drivers.canopen.codec import transmit_pdos

LASTS_TICKS = 300

Pattern = Callable[[Random], Iterator[bool]]  # Ticks that are lost, without end.


def share(rng: Random) -> Iterator[bool]:
    """Each tick for itself, up to every second."""
    lost = rng.uniform(0.02, 0.5)
    while True:
        yield rng.random() < lost


def bursts(rng: Random) -> Iterator[bool]:
    """Some in a row, and then some with all."""
    longest, pause = rng.randint(2, 9), rng.choice((3, 10, 30))
    while True:
        yield from [True] * rng.randint(1, longest)
        yield from [False] * rng.randint(1, 2 * pause)


def periodic(rng: Random) -> Iterator[bool]:
    """2 of 5, and others like it."""
    lost, of = rng.choice(((2, 5), (2, 4), (1, 3), (1, 2), (3, 5)))
    while True:
        yield from [True] * lost + [False] * (of - lost)


def _samples(pattern: Pattern) -> Fault:
    def fault(on: BreakableArm) -> Iterator[None]:
        rng = Random(on.rig.ticks)
        answers = [pdo.cob_id for pdo in transmit_pdos(rng.choice(on.drives))]
        for lost in pattern(rng):
            with on.losing(*answers) if lost else nullcontext():
                yield

    return fault


def _deadlines(pattern: Pattern) -> Fault:
    def fault(on: BreakableArm) -> Iterator[None]:
        rng = Random(on.rig.ticks)
        periods = rng.choice((1.2, 2.2))  # late, which leaves one deadline or two out
        for lost in pattern(rng):
            with on.late(periods * on.period_s) if lost else nullcontext():
                yield

    return fault


LOSSES = tuple(
    Case(f"{what}: {pattern.__name__}", condition, lose(pattern), LASTS_TICKS)
    for what, condition, lose in (
        ("samples of a drive", Condition.SAMPLE_MISSING, _samples),
        ("deadlines", Condition.LATE, _deadlines),
    )
    for pattern in (share, bursts, periodic)
)
