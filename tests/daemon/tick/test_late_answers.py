"""Answers that a busy machine holds up, in lockstep: drives that measure later than they were asked
to, as a simulated arm does whose process waits for a processor."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from bench.rigs.lockstep import OPENARM, ROMEO, Rig, lockstep_rig
from daemon.faults.conditions import Condition
from daemon.modes.table import Event, Mode
from daemon.protocol.state import State

T, USUAL_S = 0.01, 0.0006


@dataclass
class Held:
    """A rig whose answers can be held up."""

    rig: Rig
    clock_s: float = 0.0
    late_s: float = 0.0

    def step(self, late_s: float) -> State:
        """One tick, whose answers are here so much later than usual."""
        self.clock_s, self.late_s = 0.0, late_s
        self.rig.step()
        return self.rig.state()

    def step_late(self, late_s: float) -> State:
        """The same of drives that got their SYNC so late."""
        self.rig.lockstep._phase = (self.late_s - late_s) / T
        return self.step(late_s)


@contextmanager
def held(folder: Path) -> Iterator[Held]:
    """Tracking."""
    with lockstep_rig(folder) as rig:
        found, guard = Held(rig), rig.guard

        def answered() -> None:
            guard()
            found.clock_s = found.late_s + USUAL_S

        rig.guard = answered
        rig.drives._clock = lambda: found.clock_s
        rig.enable()
        rig.request(Event.START)
        rig.run(3.0)
        yield found


def test_a_late_sample_is_bridged_and_changes_no_residual() -> None:
    rng = np.random.default_rng(5)
    late = rng.random(700) < 0.1
    with held(ROMEO) as arm:
        punctual = [arm.step_late(0.0) for _ in range(700)]
        states = [arm.step_late(rng.uniform(0.002, 0.006) * one) for one in late.tolist()]
        assert arm.rig.mode is Mode.TRACKING
    np.testing.assert_array_equal([any(state.fresh) for state in states], ~late)
    most, usual = (np.abs([s.residual for s in some]).max() for some in (states, punctual))
    assert most < 1.5 * usual


@pytest.mark.parametrize("folder", [ROMEO, OPENARM], ids=lambda folder: folder.name)
def test_answers_that_are_late_are_not_missing(folder: Path) -> None:
    found = set()
    with held(folder) as arm:
        rig = arm.rig
        for tick in range(60):
            state = arm.step(0.005 if tick % 3 else 0.0)
            assert any(state.fresh) == (tick % 3 == 0)
            found |= {finding.condition for finding in rig.last.findings}
        assert rig.mode is Mode.TRACKING
        assert rig.tick.losses.share.max() < 0.01
    assert found == {Condition.SAMPLE_MISSING}


@pytest.mark.parametrize("every", [2, 4])
def test_an_arm_whose_answers_are_late_too_often_holds_and_is_not_armed(every: int) -> None:
    """In more than a third of the ticks; seldom ones only raise levels."""
    with held(OPENARM) as arm:
        rig = arm.rig
        assert not rig.permit()
        for tick in range(600):
            arm.step(0.005 if tick % every == 0 else 0.0)
        assert any(arm.step(0.0).fresh)
        often = every == 2
        assert (rig.mode is Mode.HOLDING) is often
        assert (rig.tick.controller.machine.cause.startswith(Condition.NOT_SENSING)) is often
        if not often:
            return
        assert any(Condition.NOT_SENSING in reason for reason in rig.permit())
        for _ in range(250):
            arm.step(0.0)
        assert not rig.permit()


@pytest.mark.parametrize("folder", [ROMEO, OPENARM], ids=lambda folder: folder.name)
def test_a_stop_is_seen_in_late_answers(folder: Path) -> None:
    found = set()
    with held(folder) as arm:
        rig = arm.rig
        rig.request(Event.DISABLE)
        for _ in range(30):
            arm.step(0.005)
            found |= {finding.condition for finding in rig.last.findings}
        assert rig.mode is Mode.OFF
        assert not rig.last.unproved
    assert found <= {Condition.SAMPLE_MISSING, Condition.NOT_SENSING}
