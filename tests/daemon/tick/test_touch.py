"""One touch in lockstep, from SYNC to setpoint: how the arm yields and goes on; and its replay."""

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import Rig, lockstep_rig
from daemon.modes.table import YIELDING, Event, Mode
from daemon.protocol.state import STATE_FORMAT, Snapshot, State
from programs.clients.recorder import _Stamp, _StreamWriter
from programs.clients.replay import replay

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
        format=STATE_FORMAT,
        joints=c.joint_names,
        half_gap=[joint.half_gap for joint in c.joints],
        thresholds=[joint.thresholds.contact for joint in c.joints],
        period_s=c.period_s,
        tick=rig.tick.number,
        memory=rig.tick.estimator.memory(),
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
        assert rig.permit("the test") == []
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


def test_the_modes_of_a_touch(run: Run) -> None:
    assert run.modes() == ["enabling", "holding", "tracking", "admittance", "tracking"]


def test_a_touch_is_named_with_its_joint_and_sign(run: Run) -> None:
    first = run.ticks(Mode.ADMITTANCE)[0]
    assert re.match(r"contact of \+\S+ Nm at LElbowRoll", first.cause)
    contacts = [event.contact for event in first.notices if event.contact]
    assert [(c.joint, c.level) for c in contacts] == [("LElbowRoll", "contact")]
    assert contacts[0].torque > contacts[0].threshold
    reported = [e.text for e in first.notices if e.kind == "mode"]
    assert reported == [f"tracking -> admittance: {first.cause}"]


def test_the_first_touch_is_the_push_and_no_false_alarm(run: Run) -> None:
    felt = [i for i, state in enumerate(run.states) if any(e.contact for e in state.notices)]
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
    # Where it begins to yield, what a motor did not reach is given up.
    yields = np.array(
        [
            after.mode in YIELDING and after.mode != before.mode
            for before, after in pairwise(run.states)
        ]
    )
    given_up = yields[:, None] & (np.abs(setpoints[1:]) <= np.abs(setpoints[:-1]))
    assert ((jumps <= run.acceleration * T + 1e-12) | given_up).all()
    assert jumps.max() > 0.0
    assert given_up.any(axis=1).sum() <= 2, "in one tick of each touch"


def test_the_same_seed_gives_the_same_states_bit_by_bit(run: Run) -> None:
    again = touched_and_resumed()
    assert len(again.states) == len(run.states)
    for before, after in zip(run.states, again.states, strict=True):
        assert msgspec.structs.replace(after, timing=before.timing) == before


def write(path: Path, run: Run, states: list[State]) -> Path:
    with path.open("xb") as stream:
        log = _StreamWriter(stream, run.snapshot)
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
