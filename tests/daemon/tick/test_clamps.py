"""Clamps in lockstep: what the arm presses after it ran into something, and what it is refused."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from bench.rigs.faulty_wire import FaultyWire
from bench.rigs.lockstep import Rig, lockstep_rig
from daemon.config.schema import Configuration
from daemon.modes.contact_reactions import ContactReaction
from daemon.modes.table import Event, Mode
from drivers.can.wire import Wire
from tests.daemon.tick.clamps import (
    ARMS,
    FALLS_AFTER_S,
    Case,
    Clamps,
    Obstacle,
    configured,
    measure,
    meet,
    squeeze,
)

R = ContactReaction
HALF_S, FREE_S = 0.5, 1.0
# Ripple of a torque that only falls [Nm]. Below the contact level it may be anything: there the
# link lies in its gap, against the clamp.
RIPPLE = 0.1
# By how much more than its contact level the arm may press a hand behind it [Nm].
MARGIN = 0.3
ELBOW, SHOULDER = 2, 0
ELBOW_CASE = Case(arm="romeo", joint="LElbowRoll", stiffness=40.0, speed=0.33)
SHOULDER_CASE = replace(ELBOW_CASE, joint="LShoulderPitch")
COLUMN_CASE = replace(ELBOW_CASE, arm="desk arm", joint="column")


@pytest.mark.parametrize(
    ("case", "peak"),
    [
        (replace(SHOULDER_CASE, stiffness=600.0, speed=0.9), 13.0),
        (replace(COLUMN_CASE, stiffness=600.0, speed=0.9), 7.0),
    ],
    ids=str,
)
def test_armed_it_gives_up_its_setpoint_where_it_begins_to_yield(case: Case, peak: float) -> None:
    """A setpoint that only sinks at the acceleration limit presses up to 19.6 and 9.2 Nm, and then
    its drive does not seem to follow."""
    found = measure(replace(case, armed=True))
    assert found.modes[:2] == (Mode.TRACKING, Mode.ADMITTANCE)
    assert Mode.FAULTED not in found.modes
    assert found.peak < peak


@pytest.mark.parametrize(
    "case",
    [
        ELBOW_CASE,
        replace(ELBOW_CASE, armed=True, contact=R.REPORT),
        replace(SHOULDER_CASE, speed=0.6),
        replace(SHOULDER_CASE, stiffness=150.0, started=True),  # its own weight lies on the clamp
        replace(SHOULDER_CASE, stiffness=4000.0),
        replace(COLUMN_CASE, stiffness=600.0, speed=0.6),  # at its current limit
        replace(COLUMN_CASE, joint="swing", stiffness=4000.0, speed=0.6),
        replace(COLUMN_CASE, joint="swing", stiffness=600.0, started=True),
    ],
    ids=str,
)
def test_it_releases_an_obstacle_that_it_ran_into(case: Case) -> None:
    found = measure(case)
    assert found.modes == (Mode.TRACKING, Mode.RELEASING, Mode.STOPPING, Mode.HOLDING)
    assert found.peak >= found.stood > 2.0 * found.contact
    assert found.rise <= RIPPLE
    assert found.half_s <= HALF_S
    assert found.free_s <= FREE_S
    assert found.last < found.contact


@pytest.mark.parametrize(
    "case",
    [
        replace(ELBOW_CASE, stiffness=150.0, hand=600.0),
        replace(SHOULDER_CASE, hand=600.0),
        replace(COLUMN_CASE, stiffness=150.0, hand=600.0),
    ],
    ids=str,
)
def test_a_person_behind_it_feels_no_more_than_the_clamp_and_a_contact(case: Case) -> None:
    found = measure(case)
    assert found.modes[-2:] == (Mode.STOPPING, Mode.HOLDING)
    assert found.modes.count(Mode.RELEASING) == 1
    assert found.behind > 1.0
    assert found.hand <= found.contact + MARGIN


@contextmanager
def releasing(case: Case, **supervisor: int) -> Iterator[tuple[Rig, FaultyWire, Clamps, Obstacle]]:
    """An arm that has begun to release a clamp, and its wire."""
    wires: list[FaultyWire] = []

    def between(wire: Wire) -> FaultyWire:
        wires.append(FaultyWire(wire))
        return wires[0]

    def configure(c: Configuration) -> Configuration:
        c = configured(c, case.joint, case.speed, case.contact)
        changed = msgspec.structs.replace(c.supervisor, **supervisor)
        return msgspec.structs.replace(c, supervisor=changed)

    with lockstep_rig(ARMS[case.arm], configure=configure, between=between) as rig:
        clamps = Clamps(rig)
        clamp = meet(rig, clamps, case)
        while rig.mode is not Mode.RELEASING:
            rig.step()
        yield rig, wires[0], clamps, clamp


@pytest.mark.parametrize("torque", [2.0, 8.0])
@pytest.mark.parametrize("joint", [ELBOW, SHOULDER])
def test_a_person_who_presses_against_the_release_ends_it(joint: int, torque: float) -> None:
    """On the other side of the elbow that lets go, or at the shoulder."""
    with releasing(replace(ELBOW_CASE, contact=R.REPORT)) as (rig, _, clamps, clamp):
        rig.run(0.2)
        held = clamps.felt(clamp)
        assert rig.mode is Mode.RELEASING
        # More than the clamp: the torque on the elbow changes its sign.
        behind = held + torque if joint == ELBOW else torque
        rig.arm.external_torque[joint] = clamp.side * behind
        pressed_s = rig.time_s
        rig.run(0.3)
        # A torque that changes its sign at one joint passes through zero.
        ends = {
            ELBOW: r"let go of contact at LElbowRoll \(",
            SHOULDER: r"pressed from elsewhere while it let go: contact of \S+ Nm at LShoulder",
        }
        assert re.match(ends[joint], rig.last.cause)
        stopped = [rig.mode]
        rig.run(0.5, lambda: stopped.append(rig.mode))
        assert rig.time_s - pressed_s < 1.0
        assert stopped[-1] is Mode.HOLDING
        assert Mode.RELEASING not in stopped


@pytest.mark.parametrize("case", [SHOULDER_CASE, replace(COLUMN_CASE, stiffness=600.0)], ids=str)
@pytest.mark.parametrize("lost", [2, 3, 0.1])
def test_lost_samples_do_not_keep_the_clamp_pressed(case: Case, lost: float) -> None:
    """Some ticks in a row without an answer of one drive, or a share of all ticks."""
    rng, braked = np.random.default_rng(3), np.inf
    with releasing(case) as (rig, wire, clamps, clamp):
        rig.run(0.05)
        drives = rig.robot.configuration.joint_drives
        for tick in range(250):
            loses = rng.random() < lost if lost < 1 else tick < lost
            wire.lost = {0x180 + drives[rng.integers(len(drives))].node} if loses else set()
            rig.step()
            assert rig.last.decision is not None
            speed = float(np.abs(rig.last.decision.velocity).max())
            assert rig.last.sensing.all() or rig.mode is not Mode.RELEASING or speed <= braked
            braked = max(speed - 1e-3, 0.0)  # what an unsure tick may ask for at most
        assert rig.mode is Mode.HOLDING
        assert rig.last.cause.startswith(f"let go of contact at {case.joint}")
        level = rig.robot.configuration.joints[clamp.joint].thresholds.contact
        assert clamps.felt(clamp) < level


def test_a_release_ended_by_doubt_is_repeated_afterwards() -> None:
    """Seven ticks in a row without one drive, again and again: its residual begins anew."""
    case = replace(SHOULDER_CASE, stiffness=600.0)
    with releasing(case, stale_ticks=12) as (rig, wire, clamps, clamp):
        rig.run(0.2)  # below its collision level by now
        node = rig.robot.configuration.joint_drives[clamp.joint].node
        causes = []
        for tick in range(300):
            wire.lost = {0x180 + node} if tick < 120 and tick % 20 < 7 else set()
            rig.step()
            causes += [rig.last.cause] if rig.last.cause not in causes else []
        assert "not sensing contact: LShoulderPitch" in causes, causes
        assert rig.last.cause.startswith(f"let go of contact at {case.joint}")
        level = rig.robot.configuration.joints[clamp.joint].thresholds.contact
        assert clamps.felt(clamp) < level


def to_hold(c: Configuration) -> Configuration:
    c = configured(c, "LElbowRoll", 0.33, R.REPORT)
    reactions = msgspec.structs.replace(c.reactions, collision=R.HOLD)
    return msgspec.structs.replace(c, reactions=reactions)


def test_configured_to_hold_at_a_clamp_it_does_not_start_against_it() -> None:
    """Unarmed before a clamp of 40 Nm/rad it used to accept `start`, and to press on."""
    with lockstep_rig(configure=to_hold) as rig:
        clamps = Clamps(rig)
        clamp = meet(rig, clamps, ELBOW_CASE)
        while rig.mode is not Mode.HOLDING:
            rig.step()
        held = clamps.felt(clamp)
        assert held > 3.0
        reasons = rig.tick.controller.request(Event.START, "me", rig.time_s)
        felt = rig.estimate.residual[ELBOW]
        level = rig.tick.estimator.detector.levels.collision[ELBOW]
        assert reasons == [
            f"contact of {felt:+.2f} Nm at LElbowRoll, above its collision level of "
            f"{level:.2f} Nm: free it first"
        ]
        rig.run(2.0)
        assert rig.mode is Mode.HOLDING
        assert clamps.felt(clamp) < held + RIPPLE


def test_a_clamp_is_released_again_after_a_new_start() -> None:
    """Unarmed, 40 Nm/rad: never again beyond what the first blow was."""
    with lockstep_rig(configure=lambda c: configured(c, "LElbowRoll", 0.33, R.ADMITTANCE)) as rig:
        clamps = Clamps(rig)
        clamp = meet(rig, clamps, ELBOW_CASE)
        peaks, modes = [], [rig.mode]
        for _ in range(2):
            begun = len(clamps.trace)
            for _ in range(300):
                rig.step()
                if rig.mode is not modes[-1]:
                    modes.append(rig.mode)
            peaks.append(max(felt[0] for _, felt in clamps.trace[begun:]))
            assert clamps.felt(clamp) < 0.4
            assert rig.tick.controller.request(Event.START, "me", rig.time_s) == []
    assert modes.count(Mode.RELEASING) == 2
    assert 3.0 < max(peaks) < 4.5


def test_a_torque_that_rises_or_stays_is_distinguished_from_one_that_falls() -> None:
    """The figures of a squeeze, on made-up torques."""
    with lockstep_rig() as rig:
        clamps = Clamps(rig)
    time_s = np.arange(0.0, 2.0, 0.001)
    for torque, rise, half_s in (
        (8.0 * np.exp(-5.0 * time_s), 0.0, np.log(2.0) / 5.0),
        (np.full_like(time_s, 8.0), 0.0, 2.0),
        (4.0 + 2.0 * time_s, 2.0 * (1.999 - FALLS_AFTER_S), 2.0),
    ):
        clamps.trace[:] = [(t, [each]) for t, each in zip(time_s, torque, strict=True)]
        found = squeeze(clamps, 0.0, 0.4, True, ())
        assert found.rise == pytest.approx(rise, abs=0.01)
        assert found.half_s == pytest.approx(half_s, abs=0.01)
