"""An arm that does not sense contact at some joint, in lockstep: its reactions and notices."""

import itertools
from collections.abc import Iterator
from contextlib import contextmanager

import msgspec
import numpy as np
import pytest

from bench.rigs.faulty_wire import FaultyWire
from bench.rigs.lockstep import Rig, lockstep_rig
from daemon.config.schema import Configuration
from daemon.faults import detector
from daemon.modes.table import Event, Mode
from daemon.protocol.state import State
from daemon.service.sensitivity import sensitivity_now
from daemon.tick.sensing import AGAIN_S
from drivers.can.wire import Wire
from drivers.canopen.codec import transmit_pdos

ELBOW, NAME = 2, "LElbowRoll"
T = 0.01


def patient(c: Configuration) -> Configuration:
    """Missing samples alone are no fault; their joint senses nothing."""
    supervisor = msgspec.structs.replace(c.supervisor, stale_ticks=200)
    return msgspec.structs.replace(c, supervisor=supervisor)


class Losses:
    """A rig, and how the samples of its drives get lost."""

    def __init__(self, rig: Rig, wire: FaultyWire) -> None:
        self.rig, self._wire = rig, wire
        drives = rig.robot.configuration.joint_drives
        self._pdos = [{pdo.cob_id for pdo in transmit_pdos(drive)} for drive in drives]

    def led(self) -> None:
        """Tracking, until a hand leads it."""
        self.rig.enable()
        self.rig.request(Event.START)
        self.rig.run(0.7)
        assert self.rig.permit("the test") == []
        self.rig.arm.external_torque[ELBOW] = 2.0
        self.rig.run(0.5)
        assert self.rig.mode is Mode.ADMITTANCE

    def tick(self, joint: int) -> None:
        """One tick without the samples of this joint."""
        self._wire.lost = self._pdos[joint]
        self.rig.step()

    def states(self, pattern: str, seconds: float, *joints: int) -> list[State]:
        """States while samples of these joints, by default of the elbow, are lost in every tick of
        `pattern` that is an x."""
        states, pdos = [], set().union(*(self._pdos[joint] for joint in joints or (ELBOW,)))
        for k in range(round(seconds / T)):
            self._wire.lost = pdos if pattern[k % len(pattern)] == "x" else set()
            states += self.rig.states(T)
        self._wire.lost = set()
        return states


@contextmanager
def lossy_rig() -> Iterator[Losses]:
    wires: list[FaultyWire] = []

    def between(wire: Wire) -> FaultyWire:
        wires.append(FaultyWire(wire))
        return wires[0]

    with lockstep_rig(configure=patient, between=between) as rig:
        assert rig.robot.configuration.joint_names[ELBOW] == NAME
        yield Losses(rig, wires[0])


BURSTS = "xxxxxxx.."  # of seven ticks; in between the residual has no time to rise


def test_an_arm_that_is_led_holds_within_ticks_of_bursts() -> None:
    with lossy_rig() as lossy:
        lossy.led()
        states = lossy.states(BURSTS, 4.0)
    led = [state for state in states if state.mode == Mode.ADMITTANCE]
    assert len(led) < 2 + 5, "it senses for two periods and a half without samples"
    assert {state.mode for state in states[len(led) :]} == {Mode.STOPPING, Mode.HOLDING}
    assert not states[-1].armed


def test_bursts_of_lost_samples_do_not_count_as_quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    """The quiet time alone: no arm goes on with its trajectory in the hand that leads it."""
    monkeypatch.setattr(detector.FaultDetector, "_of_sensing", lambda *_: iter(()))
    with lossy_rig() as lossy:
        lossy.led()
        states = lossy.states(BURSTS, 4.0)
    assert {state.mode for state in states} == {Mode.ADMITTANCE}
    felt = np.array([state.thresholded[ELBOW] for state in states[100:]])
    assert not felt.any(), "nothing else keeps the arm in the hand"


@pytest.mark.parametrize("event", [Event.STOP, Event.PAUSE])
def test_an_arm_whose_drives_fail_in_turn_begins_and_stops(event: Event) -> None:
    """Never a tick with all samples, from the start on."""
    with lossy_rig() as lossy:
        rig, names = lossy.rig, lossy.rig.robot.configuration.joint_names
        turn = itertools.cycle(range(len(names)))

        def run(seconds: float) -> None:
            for _ in range(round(seconds / T)):
                lossy.tick(next(turn))

        run(0.1)
        rig.request(Event.ENABLE)
        run(0.5)
        rig.request(Event.START)
        run(0.5)
        assert rig.mode is Mode.TRACKING
        rig.request(event)
        run(0.4)
        assert rig.mode is Mode.HOLDING


def test_intermittent_sensing_is_reported_once_and_when_it_is_over() -> None:
    with lossy_rig() as lossy:
        lossy.rig.enable()
        states = lossy.states("xxxx.", 2.0) + lossy.rig.states(AGAIN_S + 0.1)
    deaf = [state for state in states if state.sensing and not state.sensing[ELBOW]]
    assert len({since(state) for state in deaf}) == 40, "once in each burst"
    assert {tuple(np.flatnonzero(np.invert(state.sensing))) for state in deaf} == {(ELBOW,)}
    assert all(0.0 <= state.time_s - since(state) < 1.5 * T for state in deaf)
    found, over = (s for s in states if any("sensing contact" in n.text for n in s.notices))
    assert found.notices[0].text == f"not sensing contact: {NAME}"
    lost_s = since(states[-1]) - since(found)
    assert 1.0 < lost_s < 2.0
    text = f"sensing contact again for {AGAIN_S:g} s: {NAME} after {lost_s:.2f} s"
    assert [notice.text for notice in over.notices] == [text]
    assert over.time_s - since(over) == pytest.approx(AGAIN_S, abs=1.1 * T)


def since(state: State) -> float:
    assert state.sensing_since_s is not None
    return state.sensing_since_s[ELBOW]


def test_a_joint_that_does_not_sense_has_no_smallest_touch() -> None:
    with lossy_rig() as lossy:
        lossy.rig.enable()
        before = sensitivity_now(lossy.rig.tick)
        assert before is not None
        lossy.states("x", 5 * T)
        felt = sensitivity_now(lossy.rig.tick)
        lossy.states(".", 10 * T)
        after = sensitivity_now(lossy.rig.tick)
        lossy.states("x", 5 * T, *range(len(before.joints)))
        nowhere = sensitivity_now(lossy.rig.tick)
    assert felt is not None
    assert after is not None
    for now, then in ((felt.moving, before.moving), (felt.resting, before.resting)):
        assert now[ELBOW] is None
        assert None not in [*now[:ELBOW], *now[ELBOW + 1 :], *then]
    assert None not in after.resting
    assert nowhere is not None
    assert {*nowhere.moving, *nowhere.resting} == {None}
    assert len(nowhere.tool_moving.undetected) == len(nowhere.tool_resting.undetected) == 3
    assert msgspec.json.decode(msgspec.json.encode(felt), type=type(felt)) == felt
