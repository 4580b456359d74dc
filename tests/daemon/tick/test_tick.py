"""The whole program in lockstep with the simulated arm, from SYNC to setpoint."""

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import numpy as np
import pytest

from bench.rigs.breakable_arm import MAKES, stage, start
from bench.rigs.lockstep import SINGLE_JOINT, Rig, lockstep_rig
from daemon.config.schema import Configuration
from daemon.modes.table import Event, Mode
from daemon.protocol.state import State
from daemon.tick.controller import Controller
from daemon.tick.decision import ControlInput, Decision
from daemon.tick.telemetry import TickRecord, state_of
from daemon.tick.tick import LONGEST_STEP
from drivers.canopen.codec import transmit_pdos
from estimator.estimate import Flag

ELBOW = 2
T = 0.01


@pytest.fixture
def rig() -> Iterator[Rig]:
    with lockstep_rig() as made:
        yield made


def test_stop_ends_the_trajectory_and_the_permission(rig: Rig) -> None:
    rig.enable()
    rig.request(Event.START)
    rig.run(0.7)
    assert rig.permit("the test") == []
    rig.run(0.01)
    rig.request(Event.STOP)
    states = rig.states(0.6)
    assert (states[0].mode, states[-1].mode) == ("stopping", "holding")
    assert not any(state.armed or state.moving for state in states)
    assert np.ptp([state.link_position[0] for state in states[-10:]]) < 1e-3
    disarmed = [e.text for e in states[0].notices]
    assert disarmed == ["disarmed: stop by the bench", "tracking -> stopping: stop by the bench"]


def test_contacts_at_rest_do_not_count_against_a_trajectory(rig: Rig) -> None:
    rig.enable()
    rig.tick.estimator.interrupted[:] = 31
    rig.run(0.05)
    rig.request(Event.START)
    rig.run(0.7)
    assert rig.permit("the test") == []
    rig.arm.external_torque[ELBOW] = 4.0
    rig.run(0.3)
    assert rig.mode is Mode.ADMITTANCE
    rig.arm.external_torque[ELBOW] = 0.0
    states = rig.states(3.5)
    assert states[-1].mode == "tracking", states[-1].cause


def test_disable_in_motion_stops_first_and_leaves_the_drives_holding(rig: Rig) -> None:
    rig.enable()
    rig.request(Event.START)
    rig.run(0.7)
    rig.request(Event.DISABLE)
    states = rig.states(0.7)
    assert (states[0].mode, states[-1].mode) == ("stopping", "off")
    assert all(set(s.drives) == {"operation enabled"} for s in states if s.mode == "stopping")
    assert set(states[-1].drives) == {"quick stop active"}
    assert np.ptp([s.link_position[0] for s in states[-10:]]) < 1e-3


def test_a_contact_shorter_than_the_debounce_is_none() -> None:
    def debounced(c: Configuration) -> Configuration:
        estimator = msgspec.structs.replace(c.estimator, debounce=5)
        return msgspec.structs.replace(c, estimator=estimator)

    with lockstep_rig(SINGLE_JOINT, configure=debounced) as rig:
        rig.enable()
        assert rig.permit("the test") == []
        rig.arm.external_torque[0] = 4.0
        states = rig.states(0.3)
    felt = [any(state.thresholded) for state in states]
    yields = [state.mode == "admittance" for state in states]
    assert yields.index(True) - felt.index(True) == 4


def test_before_the_first_samples_there_is_no_state(rig: Rig) -> None:
    assert rig.tick.last is None
    rig.tick.begin(rig.time_s)  # no drive answers this SYNC
    rig.tick.finish(0.0)
    with pytest.raises(RuntimeError, match="no complete samples"):
        rig.state()
    assert rig.permit("the test") == ["no samples of the drives yet"]
    (reason,) = rig.tick.controller.request(Event.ENABLE, "the test", 0.0)
    assert reason == "no samples of the drives yet"


def test_the_record_of_a_tick_stays_as_it_was(rig: Rig) -> None:
    """Whatever the ticks after it measure and decide."""
    rig.enable()
    rig.request(Event.START)
    records, states = [], []
    for number in range(120):
        rig.arm.external_torque[ELBOW] = 2.0 * (number > 80)
        rig.step()
        records.append(rig.last)
        states.append(rig.state())
    assert len({id(record) for record in records}) == len(records)
    assert states[0].link_position != states[-1].link_position
    assert any(state.notices for state in states)
    assert [state_of(record) for record in records] == states
    arrays = [records[0].samples.link_position, records[0].samples.age_s]
    assert not any(array.flags.writeable for array in arrays)


def test_a_tick_without_samples_keeps_the_estimate_and_flags_it(rig: Rig) -> None:
    rig.enable()
    before = rig.last
    rig.lockstep.pump()
    rig.tick.begin(rig.time_s)  # no drive answers this SYNC
    rig.tick.finish(0.0)
    rig.ticks += 1
    silent = rig.last
    assert not silent.samples.fresh.any()
    assert before.estimate is not None
    assert silent.estimate is not None
    assert silent.estimate.flags == Flag.BRIDGED
    np.testing.assert_array_equal(silent.estimate.residual, before.estimate.residual)
    assert silent.sensing.all()
    assert silent.interval_s == pytest.approx(T)
    assert silent.number == before.number + 1
    rig.step()
    assert rig.estimate.flags == Flag.LATE
    assert rig.last.interval_s == pytest.approx(T)


def test_starting_moves_and_energises_nothing(rig: Rig) -> None:
    states = rig.states(0.3)
    assert {state.mode for state in states} == {"off"}
    assert not any(v for state in states for v in state.setpoint)
    assert "operation enabled" not in {name for state in states for name in state.drives}


def test_a_touch_that_begins_while_the_arm_stops_is_yielded_to(rig: Rig) -> None:
    rig.enable()
    assert rig.permit("the test") == []
    rig.request(Event.START)
    rig.run(4.3)
    rig.request(Event.PAUSE)
    rig.arm.external_torque[ELBOW] = 1.5
    rig.run(0.05)
    assert rig.mode is Mode.STOPPING
    rig.run(0.6)
    assert rig.mode is Mode.ADMITTANCE


def references(rig: Rig, times_s: list[float]) -> list[float]:
    """References of the moving joint, in ticks at these times from now [s]."""
    found = []
    for time_s in times_s:
        rig.tick.begin(rig.time_s + time_s)
        rig.lockstep.pump()
        rig.tick.finish(0.0)
        found.append(float(rig.decision.reference[0]))
    return found


def test_the_trajectory_follows_the_clock_of_late_ticks_without_a_jump(rig: Rig) -> None:
    rig.enable()
    rig.request(Event.START)
    rig.run(4.3)  # past the ramp, where the speed hardly changes
    before = rig.state().reference[0]
    late = references(rig, [T * k for k in (0.0, 1.4, 2.0, 3.0, 8.0)])
    speed = late[0] - before
    assert abs(speed) > 1e-4
    # One that came 0.4 T late moves on by as much more, and the one after it by as much less.
    assert np.diff(late) / speed == pytest.approx([1.4, 0.6, 1.0, LONGEST_STEP], abs=0.02)


def test_a_contact_is_reported_only_while_the_drives_are_on() -> None:
    """Off, a brake carries what the residual takes for a touch."""
    reported: dict[Mode, int] = {}
    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.run(0.1)
        threshold = rig.robot.configuration.joints[0].thresholds.contact
        for mode in (Mode.OFF, Mode.HOLDING):
            if mode is Mode.HOLDING:
                rig.enable()
            assert rig.mode is mode
            rig.arm.external_torque[0] = 3.0 * threshold
            states = rig.states(0.5)
            rig.arm.external_torque[0] = 0.0
            rig.run(0.5)
            assert any(state.thresholded[0] for state in states)
            reported[mode] = sum(event.kind == "contact" for s in states for event in s.notices)
    assert reported[Mode.OFF] == 0 < reported[Mode.HOLDING]


def test_every_field_of_a_record_and_state_is_filled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Defaults are for recordings and logs that lack a field, not for a tick that forgets it."""
    filled: dict[str, set[str]] = {}

    def spy(made: Callable[..., Any]) -> Callable[..., Any]:
        def make(**fields: Any) -> Any:
            filled[made.__name__] = set(fields)
            return made(**fields)

        return make

    monkeypatch.setattr("daemon.tick.tick.TickRecord", spy(TickRecord))
    monkeypatch.setattr("daemon.tick.telemetry.State", spy(State))
    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.run(0.1)
        rig.state()
    fields = {field.name for field in dataclasses.fields(TickRecord)}
    assert fields ^ filled["TickRecord"] == set()
    assert set(State.__struct_fields__) ^ filled["State"] == set()


def test_the_controller_gets_the_age_of_each_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames of the elbow's drive are missing for two ticks."""
    seen: list[np.ndarray | None] = []
    step = Controller.step

    def spy(controller: Controller, time_s: float, dt: float, observed: ControlInput) -> Decision:
        seen.append(observed.age_s)
        return step(controller, time_s, dt, observed)

    monkeypatch.setattr(Controller, "step", spy)
    with stage(MAKES[0]) as on:
        start(on, armed=False)
        on.rig.step()
        assert seen[-1] is None
        drive = on.drives[ELBOW]
        with on.losing(*(pdo.cob_id for pdo in transmit_pdos(drive))):
            for missed in (1, 2):
                on.rig.step()
                expected = np.zeros(len(on.drives))
                expected[ELBOW] = missed * T
                np.testing.assert_allclose(seen[-1], expected)
        on.rig.run(0.03)
        assert seen[-1] is None
