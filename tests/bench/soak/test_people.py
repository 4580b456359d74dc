"""The hand of a soak, its people with their leases, and who looks on."""

import math
from contextlib import closing
from pathlib import Path
from random import Random

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import lockstep_rig
from bench.soak.onlooker import Onlooker
from bench.soak.people import (
    HEARD_TICKS,
    LAPSES_TICKS,
    WISHES,
    Leases,
    Person,
    Step,
    View,
    operator,
    program,
)
from bench.soak.robot import gives_way, hand_script, strongest, write_robot
from daemon.modes.table import Mode
from daemon.protocol.replies import Reply
from daemon.protocol.requests import Arm
from simulator.hand import Hand
from tests.bench.soak.scenes import C


def test_the_onlooker_knows_when_a_hand_is_on_the_arm(tmp_path: Path) -> None:
    events = tmp_path / "events"

    def happen(*rows: tuple[float, str, str]) -> None:
        with events.open("ab") as stream:
            for time_s, kind, text in rows:
                event = {"monotonic_s": time_s, "kind": kind, "text": text}
                stream.write(msgspec.json.encode(event) + b"\n")

    happen((1.0, "server", "listening on x"))
    with closing(Onlooker(events)) as onlooker:
        assert not onlooker.look()
        happen((2.0, "hand", "begin push joint 2 Nm"))
        assert onlooker.look()
        happen((2.5, "hand", "end push joint 2 Nm"), (3.0, "hand", "begin guide joint to 1 rad"))
        with events.open("ab") as stream:
            stream.write(b'{"monotonic_s": 4.0, "kind": "ha')  # not whole yet
        assert onlooker.look()
        assert onlooker.touches == [(2.0, 2.5), (3.0, float("inf"))]
        with events.open("ab") as stream:
            stream.write(b'nd", "text": "begin release"}\n')
        assert not onlooker.look()
        assert onlooker.touches == [(2.0, 2.5), (3.0, 4.0)]


def test_the_hand_is_one_that_the_simulator_can_play() -> None:
    acts = hand_script(Random(1), C, 600.0)
    Hand(acts, C.joint_names, np.full(len(C.joints), 1.0))
    assert msgspec.yaml.decode(msgspec.yaml.encode(acts), type=type(acts)) is not None
    assert [act.at_s for act in acts] == sorted(act.at_s for act in acts)
    assert {type(act).__name__ for act in acts} == {"Push", "Guide", "Hold", "Release"}


def wishes(person: Person, view: View, turns: int) -> list[Step]:
    next(person)
    return [person.send(view) for _ in range(turns)]


def test_people_want_much_and_not_all_of_it_is_right() -> None:
    steps = wishes(operator(Random(1), C), View(Mode.HOLDING, False, False), 2000)
    asked = {request.command for step in steps for request in step.requests}
    assert asked >= {"start", "arm", "load", "gain", "disable", "stop", "reset", "pause", "status"}
    steps = wishes(program(Random(1), C), View(Mode.HOLDING, True, False), 400)
    assert any(step.hang_up and not step.requests for step in steps)  # it dies
    assert any(step.requests and step.requests[0].command == "disarm" for step in steps)


def test_leases_are_known_from_the_answers() -> None:
    leases, granted, refused = Leases(), Reply(ok=True), Reply(ok=False)
    short, detached = Arm(lease_s=2.0), Arm(detached=True)
    one, two = leases.connection(), leases.connection()
    leases.asked(short, one)
    assert leases.until_s == math.inf  # it may be granted before it is known
    leases.answered(short, granted, one, 10.0)
    assert (leases.until_s, leases.ticks) == (12.0, LAPSES_TICKS)
    leases.closed(two, 10.5)
    assert leases.until_s == 12.0
    leases.closed(one, 11.0)
    assert (leases.until_s, leases.ticks) == (11.0, HEARD_TICKS)
    leases.asked(detached, two)
    leases.answered(detached, refused, two, 11.0)
    assert leases.until_s == 11.0
    leases.answered(detached, granted, two, 11.0)
    leases.closed(two, 12.0)
    assert (leases.until_s, leases.ticks) == (611.0, LAPSES_TICKS)


def test_what_was_asked_and_not_answered_may_have_been_granted() -> None:
    leases = Leases()
    one, two = leases.connection(), leases.connection()
    leases.asked(Arm(lease_s=2.0), one)
    leases.closed(one, 10.0)
    assert (leases.until_s, leases.ticks) == (10.0, HEARD_TICKS)  # who held it is gone
    leases.asked(Arm(lease_s=2.0, detached=True), two)
    leases.closed(two, 11.0)
    assert leases.until_s == 13.0  # a person's lease outlives their connection
    leases.asked(Arm(lease_s=2.0), one)
    leases.closed(one, 12.0)
    assert leases.until_s == 13.0  # and no one takes it from them


@pytest.mark.parametrize("name", ["LShoulderYaw", "LWristYaw"])
def test_a_hand_presses_the_drives_about_as_far_as_they_are_said_to_give_way(
    tmp_path: Path, name: str
) -> None:
    """From the limit on, the link of a joint with a gap leaning on its far side."""
    with lockstep_rig(write_robot(tmp_path / "arm")) as rig:
        joints, i = rig.robot.configuration.joints, rig.robot.configuration.joint_names.index(name)
        upper = joints[i].limits.upper
        pose = np.array([0.5 * (joint.limits.lower + joint.limits.upper) for joint in joints])
        pose[i] = upper - 0.1
        rig.arm.plant.place(pose)
        rig.enable()
        rig.tick.controller.motion.reference[i] = upper
        rig.run(1.5)
        rig.arm.external_torque[i] = strongest(joints[i])
        beyond = []
        rig.run(0.3, lambda: beyond.append(rig.arm.plant.q[i] - upper))
        assert 0.5 < max(beyond) / gives_way(rig.robot)[i] < 0.8


def test_an_operator_has_wishes_in_every_mode() -> None:
    assert WISHES.keys() == set(Mode)
