"""The whole program in lockstep with the simulated arm, from SYNC to setpoint."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest

from bench.lockstep import SINGLE_JOINT, Rig, lockstep_rig
from daemon.config.schema import Configuration
from daemon.cycle import LONGEST_STEP
from daemon.messages import Snapshot, State
from daemon.modes import Event, Mode
from daemon.recorder import _LogWriter, _Stamp
from daemon.replay import replay
from drivers.cia402 import DriveState

ELBOW = 2
T = 0.01


@dataclass(frozen=True)
class Run:
    """One recorded run, and what a recording of it begins with."""

    states: list[State]
    snapshot: Snapshot
    acceleration: np.ndarray

    def ticks(self, mode: Mode) -> list[State]:
        return [state for state in self.states if state.mode == mode]

    def modes(self) -> list[str]:
        """Each mode that was entered, in order."""
        seen = [state.mode for state in self.states]
        return [seen[0], *(after for before, after in pairwise(seen) if after != before)]


def snapshot_of(rig: Rig) -> Snapshot:
    """As the service would give it."""
    c = rig.robot.configuration
    return Snapshot(
        joints=c.joint_names,
        half_gap=[joint.half_gap for joint in c.joints],
        thresholds=[joint.thresholds.contact for joint in c.joints],
        period_s=c.period_s,
        tick=rig.cycle.tick,
        memory=rig.cycle.estimator.memory(),
        configuration=rig.robot.text,
        urdf=rig.robot.urdf,
        program="contactd in lockstep",
    )


def touched_and_resumed() -> Run:
    """Enable, start, arm, push an elbow for 1 s, let go, and wait until the arm goes on."""
    with lockstep_rig() as rig:
        rig.run(0.1)
        snapshot = snapshot_of(rig)
        rig.request(Event.ENABLE)
        states = rig.states(0.5)
        rig.request(Event.START)
        states += rig.states(1.0)
        assert rig.cycle.controller.arm("the test") == []
        states += rig.states(0.2)
        rig.arm.external_torque[ELBOW] = 1.5
        states += rig.states(1.0)
        rig.arm.external_torque[ELBOW] = 0.0
        states += rig.states(2.8)
        acceleration = np.array([j.limits.acceleration for j in rig.robot.configuration.joints])
    return Run(states, snapshot, acceleration)


@pytest.fixture(scope="module")
def run() -> Run:
    return touched_and_resumed()


@pytest.fixture
def rig() -> Iterator[Rig]:
    with lockstep_rig() as made:
        yield made


def test_the_modes_of_a_touch(run: Run) -> None:
    assert run.modes() == ["enabling", "holding", "tracking", "admittance", "tracking"]


def test_a_touch_is_named_and_felt_with_its_sign(run: Run) -> None:
    first = run.ticks(Mode.ADMITTANCE)[0]
    assert first.cause.startswith("LElbowRoll feels +")
    contacts = [event.contact for event in first.events if event.contact]
    assert [(c.joint, c.level) for c in contacts] == [("LElbowRoll", "contact")]
    assert contacts[0].torque > contacts[0].threshold
    told = [e.text for e in first.events if e.kind == "mode"]
    assert told == [f"tracking -> admittance: {first.cause}"]


def test_the_first_touch_is_the_push_and_no_false_alarm(run: Run) -> None:
    felt = [i for i, state in enumerate(run.states) if any(e.contact for e in state.events)]
    pushed = 170  # 0.5 + 1.0 + 0.2 s of states
    assert 0 < felt[0] - pushed < 15


def test_the_pushed_link_is_named_while_it_is_pushed(run: Run) -> None:
    touched = [state.touched_link for state in run.states if any(state.thresholded)]
    assert touched.count("LElbowRoll") > 0.5 * len(touched)
    assert not any(state.touched_link for state in run.states if not any(state.thresholded))


def test_it_yields_the_way_it_is_pushed(run: Run) -> None:
    ticks = run.ticks(Mode.ADMITTANCE)
    moved = np.ptp([state.link_position[ELBOW] for state in ticks])
    assert ticks[-1].link_position[ELBOW] > ticks[0].link_position[ELBOW]
    assert 0.1 < moved < 1.5
    assert max(abs(v) for state in ticks for v in state.setpoint) <= 0.5 + 1e-12


def test_it_resumes_two_quiet_seconds_after_the_last_touch(run: Run) -> None:
    last_touch = max(s.time_s for s in run.ticks(Mode.ADMITTANCE) if any(s.thresholded))
    resumed = next(
        after
        for before, after in pairwise(run.states)
        if (before.mode, after.mode) == ("admittance", "tracking")
    )
    assert resumed.cause.startswith("quiet for 2.0")
    assert 2.0 - 1e-6 <= resumed.time_s - last_touch <= 2.02


def test_it_resumes_from_where_the_person_left_it(run: Run) -> None:
    for before, after in pairwise(run.states):
        if (before.mode, after.mode) == ("admittance", "tracking"):
            np.testing.assert_allclose(after.reference, after.link_position, atol=1e-3)
    assert run.states[-1].armed
    assert run.states[-1].moving
    moving = [s.reference[0] for s in run.states[-30:]]
    assert np.ptp(moving) > 1e-3  # and goes on


def test_no_setpoint_jumps_beyond_the_acceleration(run: Run) -> None:
    setpoints = np.array([state.setpoint for state in run.states])
    jumps = np.abs(np.diff(setpoints, axis=0))
    assert (jumps <= run.acceleration * T + 1e-12).all()
    assert jumps.max() > 0.0


def test_the_same_seed_gives_the_same_states_bit_by_bit(run: Run) -> None:
    again = touched_and_resumed()
    assert len(again.states) == len(run.states)
    for before, after in zip(run.states, again.states, strict=True):
        assert msgspec.structs.replace(after, timing=before.timing) == before


def write(path: Path, run: Run, states: list[State]) -> Path:
    with path.open("xb") as stream:
        log = _LogWriter(stream, run.snapshot)
        for state in states:
            packet = msgspec.json.encode(state)
            log.state(packet, msgspec.json.decode(packet, type=_Stamp))
        log.finish()
    return path


def test_the_replay_of_a_recording_is_bit_identical(run: Run, tmp_path: Path) -> None:
    done = replay(write(tmp_path / "run.mcap", run, run.states))
    assert done.difference is None
    assert done.identical
    assert (done.states, done.skipped, done.broken) == (len(run.states), 0, "")


def test_the_replay_finds_a_single_changed_sample(run: Run, tmp_path: Path) -> None:
    states = list(run.states)
    victim = states[120]
    current = [victim.current[0] + 1e-9, *victim.current[1:]]
    states[120] = msgspec.structs.replace(victim, current=current)
    done = replay(write(tmp_path / "run.mcap", run, states))
    assert done.difference is not None
    assert not done.identical
    assert done.difference.tick == victim.tick


def test_stop_ends_the_trajectory_and_the_permission(rig: Rig) -> None:
    rig.enable()
    rig.request(Event.START)
    rig.run(0.7)
    assert rig.cycle.controller.arm("the test") == []
    rig.run(0.01)
    rig.request(Event.STOP)
    states = rig.states(0.6)
    assert (states[0].mode, states[-1].mode) == ("stopping", "holding")
    assert not any(state.armed or state.moving for state in states)
    assert np.ptp([state.link_position[0] for state in states[-10:]]) < 1e-3
    disarmed = [e.text for e in states[0].events]
    assert disarmed == ["disarmed: stop by the bench", "tracking -> stopping: stop by the bench"]


def test_disable_in_motion_stops_first_and_leaves_the_drives_holding(rig: Rig) -> None:
    rig.enable()
    rig.request(Event.START)
    rig.run(0.7)
    rig.request(Event.DISABLE)
    states = rig.states(0.7)
    assert states[0].mode == "stopping"
    assert states[-1].mode == "off"
    on = [set(s.drives) == {"operation enabled"} for s in states if s.mode == "stopping"]
    assert all(on)
    assert set(states[-1].drives) == {"quick stop active"}
    assert np.ptp([s.link_position[0] for s in states[-10:]]) < 1e-3


def test_a_fault_of_one_drive_stops_all_and_stays_until_reset(rig: Rig) -> None:
    rig.enable()
    rig.request(Event.START)
    rig.run(0.5)
    rig.arm.drives[ELBOW].fault(0x2310, "injected by the test")
    states = rig.states(0.3)
    assert [s.mode for s in states[:2]] == ["faulted"] * 2
    assert "node 3: emergency 0x2310" in states[0].cause
    told = [e.text for s in states for e in s.events if e.kind == "fault"]
    assert sum("0x2310" in text for text in told) == 1
    others = [name for i, name in enumerate(states[-1].drives) if i != ELBOW]
    assert set(others) == {"quick stop active"}
    assert states[-1].drives[ELBOW] == "fault"
    assert not any(v for s in states for v in s.setpoint)
    controller = rig.cycle.controller
    assert "a fault is latched" in controller.request(Event.ENABLE, "a person", rig.time_s)[0]
    rig.request(Event.RESET)
    rig.run(0.6)
    assert rig.mode is Mode.OFF
    assert rig.cycle.samples is not None
    assert DriveState.FAULT not in rig.cycle.samples.states
    rig.request(Event.ENABLE)
    rig.run(0.5)
    assert rig.mode is Mode.HOLDING


def test_a_contact_while_not_armed_is_only_reported(rig: Rig) -> None:
    rig.enable()
    rig.arm.external_torque[ELBOW] = 1.0
    states = rig.states(0.3)
    assert {state.mode for state in states} == {"holding"}
    contacts = [e.contact for s in states for e in s.events if e.contact]
    assert [c.joint for c in contacts][:1] == ["LElbowRoll"]
    reasons = rig.cycle.controller.arm("the test")
    assert any("is somebody touching it" in reason for reason in reasons)


def test_debounced_a_contact_is_none_yet() -> None:
    def patient(c: Configuration) -> Configuration:
        return msgspec.structs.replace(
            c, estimator=msgspec.structs.replace(c.estimator, debounce=5)
        )

    with lockstep_rig(SINGLE_JOINT, configure=patient) as rig:
        rig.enable()
        assert rig.cycle.controller.arm("the test") == []
        rig.arm.external_torque[0] = 4.0
        states = rig.states(0.3)
    felt = [any(state.thresholded) for state in states]
    yields = [state.mode == "admittance" for state in states]
    assert yields.index(True) - felt.index(True) == 4


def test_drives_that_fall_silent_are_stale_after_three_ticks(rig: Rig) -> None:
    rig.enable()
    rig.lockstep.pump()
    modes, fresh = [], []
    for _ in range(5):
        rig.cycle.begin(rig.time_s)  # nobody answers this SYNC
        rig.cycle.finish(0.0)
        rig.ticks += 1
        modes.append(rig.mode)
        fresh.append(any(rig.cycle.state().fresh))
    assert not any(fresh)
    assert modes == [Mode.HOLDING] * 2 + [Mode.FAULTED] * 3
    assert "samples stale" in rig.cycle.controller.machine.cause


def test_before_the_first_samples_there_is_no_state(rig: Rig) -> None:
    with pytest.raises(RuntimeError, match="no complete samples"):
        rig.cycle.state()
    assert rig.cycle.controller.arm("the test") == ["no samples of the drives yet"]
    assert rig.cycle.controller.request(Event.ENABLE, "the test", 0.0) == [
        "no samples of the drives yet"
    ]


def test_starting_moves_and_energises_nothing(rig: Rig) -> None:
    states = rig.states(0.3)
    assert {state.mode for state in states} == {"off"}
    assert not any(v for state in states for v in state.setpoint)
    assert "operation enabled" not in {name for state in states for name in state.drives}


def test_a_touch_that_begins_while_the_arm_stops_is_yielded_to(rig: Rig) -> None:
    rig.enable()
    assert rig.cycle.controller.arm("the test") == []
    rig.request(Event.START)
    rig.run(4.3)
    rig.request(Event.PAUSE)
    rig.arm.external_torque[ELBOW] = 1.5
    rig.run(0.05)
    assert rig.mode is Mode.STOPPING
    rig.run(0.6)
    assert rig.mode is Mode.ADMITTANCE


def references(rig: Rig, times_s: list[float]) -> list[float]:
    """Of the moving joint, in ticks at these times from now [s]."""
    found = []
    for time_s in times_s:
        rig.cycle.begin(rig.time_s + time_s)
        rig.lockstep.pump()
        rig.cycle.finish(0.0)
        assert rig.cycle.decision is not None
        found.append(float(rig.cycle.decision.reference[0]))
    return found


def test_the_trajectory_keeps_to_the_clock_when_ticks_are_late_but_never_jumps(rig: Rig) -> None:
    rig.enable()
    rig.request(Event.START)
    rig.run(4.3)  # past the ramp, where the speed hardly changes
    before = rig.cycle.state().reference[0]
    late = references(rig, [T * k for k in (0.0, 1.4, 2.0, 3.0, 8.0)])
    speed = late[0] - before
    assert abs(speed) > 1e-4
    # One that came 0.4 T late moves on by as much more, and the one after it by as much less.
    assert np.diff(late) / speed == pytest.approx([1.4, 0.6, 1.0, LONGEST_STEP], abs=0.02)


def test_a_contact_is_told_where_the_arm_feels() -> None:
    """Off, a brake carries what the residual takes for a touch."""
    told: dict[Mode, int] = {}
    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.run(0.1)
        for mode in (Mode.OFF, Mode.HOLDING):
            if mode is Mode.HOLDING:
                rig.enable()
            assert rig.mode is mode
            threshold = rig.robot.configuration.joints[0].thresholds.contact
            rig.arm.external_torque[0] = 3.0 * threshold
            states = rig.states(0.5)
            rig.arm.external_torque[0] = 0.0
            rig.run(0.5)
            assert any(state.thresholded[0] for state in states)
            told[mode] = sum(event.kind == "contact" for s in states for event in s.events)
    assert told[Mode.OFF] == 0 < told[Mode.HOLDING]
