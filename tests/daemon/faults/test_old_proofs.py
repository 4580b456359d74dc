"""Proof of a standstill that a second fault makes untrue later: it is void, and no `reset` is
accepted while a joint moves. Judged by the simulated drives' own velocity."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace

import pytest

from bench.rigs.breakable_arm import BreakableArm, for_ever, start
from bench.rigs.drive_faults import quick_stop_not_kept, stone_deaf
from bench.rigs.faults import SHOWN, Case
from bench.study.fault_pairs import PLACE, Judge
from daemon.modes.table import Event, Mode
from simulator.sensors import Readings

MOVES = 0.3  # [rad/s], of a motor by its own power
ALLOWED = 40  # ticks


def named(name: str) -> Case:
    return next(s.case for s in SHOWN if s.place == PLACE and s.case.name == name)


@pytest.mark.parametrize("second", ["quick stop said, and not kept", "quick stop said, and hunts"])
@pytest.mark.parametrize(
    ("first", "later"),
    [
        ("SYNC lost", 20),
        ("drive deaf to SYNC", 20),
        ("stood still for 90 ms", 20),
        ("stood still for 90 ms", 60),
        ("... for 400 ms", 60),
    ],
)
def test_a_proof_is_void_when_the_drive_moves_again(first: str, later: int, second: str) -> None:
    with PLACE.stage() as on, ExitStack() as cleanup:
        start(on, armed=True)
        judge, moved = Judge(on), 0
        faults: list[Iterator[None]] = []
        for tick in range(later + 120):
            for name, begins in ((first, 0), (second, later)):
                if tick == begins:
                    faults.append(named(name).fault(on))
                    cleanup.callback(getattr(faults[-1], "close", lambda: None))
            for fault in faults:
                next(fault, None)
            on.tick()
            judge.see()
            if not (judge._speed(on.joint) > MOVES and judge._drives_itself(on.joint)):
                continue
            moved += 1
            record = on.rig.last
            assert not [n.text for n in record.notices if "stop proved" in n.text]
            if on.rig.mode is Mode.FAULTED and moved > ALLOWED:
                assert record.unproved, tick
            if on.rig.mode is Mode.FAULTED and moved == ALLOWED + 30:
                assert on.rig.ask(Event.RESET) or judge._speed(on.joint) < MOVES


def blind_velocity(on: BreakableArm) -> Iterator[None]:
    """Its velocity reads zero for ever, so that it does not brake; both encoders go on."""
    joint, arm, advance = on.joint, on.rig.arm, on.rig.arm.advance

    def zero(r: Readings) -> Readings:
        velocity = [*r.motor_velocity]
        velocity[joint] = 0
        return replace(r, motor_velocity=velocity)

    def runs_on(t: float) -> None:
        """Whenever time passes, while a reset is answered, too."""
        while arm.now < t - 1e-9:
            if on.simulated.axis.state.name == "QUICK_STOP_ACTIVE" and arm.servo.energised(joint):
                arm.servo.ramp(joint, 0.6, 60.0)
            advance(min(arm.now + 0.001, t))

    arm.advance = runs_on  # type: ignore[method-assign]
    with on.sensing(zero):
        runs = quick_stop_not_kept(on)
        for _ in for_ever():
            next(runs, None)
            yield


def test_a_reset_after_silence_needs_more_than_a_velocity_of_zero() -> None:
    with PLACE.stage() as on, ExitStack() as cleanup:
        start(on, armed=True)
        judge = Judge(on)
        with on.at(on.joint + 1):
            unreachable = stone_deaf(on)
        blind = blind_velocity(on)
        cleanup.callback(unreachable.close)  # type: ignore[attr-defined]
        cleanup.callback(blind.close)  # type: ignore[attr-defined]
        asked = 0
        for tick in range(400):
            with on.at(on.joint + 1):
                next(unreachable, None)
            next(blind, None)
            on.tick()
            judge.see()
            drives = on.rig.drives
            may = drives.master_timeout_passed or not drives.unproved()
            if on.rig.mode is Mode.FAULTED and tick % 40 == 0 and may:
                if tick > 200:
                    unreachable.close()  # type: ignore[attr-defined]  # its cause is gone
                asked += 1
                refused = on.rig.ask(Event.RESET)
                assert refused or judge._speed(on.joint) < 0.1
        assert asked > 2
        assert judge.verdict.good, judge.verdict
