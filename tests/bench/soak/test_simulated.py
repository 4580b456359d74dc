"""Some seconds of a soak in lockstep, of a program that is right and of one that is not."""

import logging
from random import Random
from typing import Any

import pytest

from bench.rigs.faults import CASES
from bench.soak import outside_faults
from bench.soak.losses import LOSSES
from bench.soak.people import Person, Step
from bench.soak.record import Part
from bench.soak.simulated import FAULTS, UNFIT, run_lockstep
from daemon.config.schema import Configuration
from daemon.modes.quiet_timer import QuietTimer
from daemon.protocol.requests import bare
from drivers.stopping.stop_watch import StopReading, StopWatch
from simulator.hand_script import Push


def test_the_lockstep_part_goes_the_same_way_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.soak.simulated.MEAN_PAUSE_S", 0.5)
    level = logging.getLogger("contactd").level
    runs = [run_lockstep(2, 2.5 / 3600.0) for _ in range(2)]
    assert logging.getLogger("contactd").level == level
    for part in runs:
        assert not part.ledger.broken, part.ledger.cases
        assert part.counts["enable done"] > 0
        assert any(what.startswith("fault: ") for what in part.counts)
    assert runs[0].counts == runs[1].counts
    assert runs[0].ledger.checked == runs[1].ledger.checked
    assert (
        runs[0].samples["error of theta, side known"]
        == runs[1].samples["error of theta, side known"]
    )


def test_a_hand_that_begins_within_a_tick_has_moved_the_arm_already(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A wrist that its drive holds in quick stop gives way at once: no motion of the arm's own."""

    def no_reset(rng: Random, c: Configuration) -> Person:
        yield Step()
        for command in ("enable", "start"):
            yield Step((bare(command),), wait_s=0.5)
        while True:
            yield Step()

    def push(rng: Random, c: Configuration, seconds: float) -> tuple[Push, ...]:
        return (Push(at_s=3.0, joint="LWristYaw", torque=0.4, duration_s=0.2),)

    over_heated = tuple(case for case in FAULTS if case.name == "over-temperature")
    monkeypatch.setattr("bench.soak.simulated.FAULTS", over_heated)
    monkeypatch.setattr("bench.soak.simulated.MEAN_PAUSE_S", 3.0)
    monkeypatch.setattr("bench.soak.simulated.hand_script", push)
    for who in ("operator", "program"):
        monkeypatch.setattr(f"bench.soak.simulated.{who}", no_reset)
    part = run_lockstep(9, 4.0 / 3600.0)  # whose only fault comes after a second
    assert part.counts["ticks faulted"] > 280, part.counts
    assert not part.ledger.broken, part.ledger.cases


def test_what_is_no_part_of_the_soak_is_a_fault_nevertheless() -> None:
    assert {case.name for case in CASES} >= UNFIT
    outside = {fault.__name__ for fault in outside_faults.FAULTS}
    assert outside >= {"sync_moved", "sync_lost", "mode_changed", "rpdo_off", "drive_restarts"}


def believes(watch: StopWatch, now: float, seen: StopReading | None) -> None:
    watch.proved = now > watch._now_s


def believes_in_quiet(timer: QuietTimer, touched: bool, time_s: float, *, sure: bool) -> None:
    timer._touched_s = time_s if touched else timer._touched_s
    timer.quiet_s = time_s - timer._touched_s


def soaked(monkeypatch: pytest.MonkeyPatch, case: str) -> Part:
    """Ten seconds of one kind of fault, without a person."""

    def resets(rng: Random, c: Configuration) -> Person:
        yield Step()
        while True:
            for command, wait_s in (("enable", 0.5), ("start", 4.5), ("reset", 1.0)):
                yield Step((bare(command),), wait_s=wait_s)

    def no_person(rng: Random, c: Configuration) -> Person:
        while True:
            yield Step()

    only = tuple(each for each in (*CASES, *LOSSES) if each.name == case)
    seed = 10 if only[0] in LOSSES else 9  # whose arm has patience with losses, or has not
    monkeypatch.setattr("bench.soak.simulated.FAULTS", only)
    monkeypatch.setattr("bench.soak.simulated.MEAN_PAUSE_S", 6.0)
    monkeypatch.setattr("bench.soak.simulated.hand_script", lambda *_: ())
    monkeypatch.setattr("bench.soak.simulated.operator", resets)
    monkeypatch.setattr("bench.soak.simulated.program", no_person)
    return run_lockstep(seed, 10.0 / 3600.0)


@pytest.mark.parametrize(
    "case",
    ["SYNC moved by a tool (0x1005)", "drive locked in 0x8130", "samples of a drive: bursts"],
)
def test_a_sound_program_breaks_none(monkeypatch: pytest.MonkeyPatch, case: str) -> None:
    part = soaked(monkeypatch, case)
    assert not part.ledger.broken, part.ledger.cases


@pytest.mark.parametrize(
    ("case", "broken", "rules"),
    [
        # Nothing but the setpoint, which a drive without SYNC never takes.
        (
            "SYNC moved by a tool (0x1005)",
            {"drivers.stopping.stop_watch.StopWatch.step": lambda self, now, seen: None},
            {"a stop is proved or the arm silent"},
        ),
        # What was commanded to stop is taken for standing a tick later.
        (
            "SYNC moved by a tool (0x1005)",
            {
                "drivers.stopping.stop_watch.StopWatch.step": believes,
                "drivers.canopen.expedited_stop.ExpeditedStop.request": lambda self, target: None,
            },
            {"no motion after a proved stop"},
        ),
        # A drive that stays in its fault is not set up anew.
        (
            "drive locked in 0x8130",
            {"daemon.service.set_up.SetUp.prove": lambda self: []},
            {"one reset is enough"},
        ),
        # A joint that senses nothing is no reason to hold.
        (
            "samples of a drive: bursts",
            {"daemon.faults.detector.FaultDetector._of_sensing": lambda self, sensing, settled: ()},
            {"no motion without sensing"},
        ),
        # What is not felt counts as quiet.
        (
            "samples of a drive: bursts",
            {"daemon.modes.quiet_timer.QuietTimer.sense": believes_in_quiet},
            {"no quiet time without sensing"},
        ),
    ],
)
def test_a_program_that_is_broken_breaks_a_rule(
    monkeypatch: pytest.MonkeyPatch, case: str, broken: dict[str, Any], rules: set[str]
) -> None:
    for what, instead in broken.items():
        monkeypatch.setattr(what, instead)
    part = soaked(monkeypatch, case)
    assert rules <= set(part.ledger.broken), part.ledger.cases
