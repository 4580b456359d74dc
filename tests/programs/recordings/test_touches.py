"""Contacts in words: the table, the shortest and the longest of each word, and simulated hands."""

import json
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from bench.rigs.lockstep import lockstep_rig
from daemon.config.schema import Configuration
from daemon.modes.table import Event, Mode
from daemon.protocol import state as protocol
from daemon.protocol.state import Notice, Snapshot, State
from estimator.payload import Payload
from programs.command_line.options import Options
from programs.contactctl.contactctl import main
from programs.recordings.touches import Contact, Evidence, contacts
from simulator.hand_script import AnyAct, Clamp, Lean, Press, Push, Release
from tests.fake_daemon import snapshot_at, state_at
from tests.programs.clients.test_replay import written
from tests.programs.recordings.test_touch_point import CONTACT, NAMES, POSE, ROBOT, a_push

CONTEXT = msgspec.structs.replace(snapshot_at(19), urdf=ROBOT.urdf)
LOAD = Payload.of(0.4, [0.0, 0.0, 0.0])
TRACKS, YIELDS, HOLDS = Mode.TRACKING, Mode.ADMITTANCE, Mode.HOLDING
ONCE = (0.1, 1.2, 1.0, TRACKS)


def states_of(*phases: tuple[float, float, float, Mode], **changes: Any) -> list[State]:
    """Phases of so many seconds: residual of the last joint and its level in force, in contact
    levels, and the mode; then half a second of nothing."""
    states = list[State]()
    for seconds, r, level, mode in (*phases, (0.5, 0.0, 1.0, TRACKS)):
        for _ in range(round(100.0 * seconds)):
            residual, threshold = np.zeros(7), CONTACT.copy()
            residual[6], threshold[6] = r * CONTACT[6], level * CONTACT[6]
            made = {"link_position": POSE.tolist(), "mode": mode} | changes
            states.append(
                state_at(len(states), residual=residual.tolist(), threshold=threshold.tolist(),
                         **made)
            )  # fmt: skip
    return states


def said(states: Sequence[State], context: Snapshot = CONTEXT) -> list[tuple[str, float]]:
    """Word and seconds of each contact."""
    found = list(contacts([context, *states]))
    return [(contact.word, round(contact.evidence.seconds, 2)) for contact in found]


@pytest.mark.parametrize(
    ("phases", "expected"),
    [
        # Ten milliseconds, and friction that holds what it may while the arm waits.
        ([(0.01, 1.2, 1, TRACKS), (2.5, 1.1, 3, YIELDS)], ("touched", 0.01)),
        ([(0.01, 1.2, 1, TRACKS)], ("touched", 0.01)),
        ([(0.38, 1.2, 1, TRACKS)], ("touched", 0.38)),
        ([(0.42, 1.2, 1, TRACKS)], ("pushed", 0.42)),
        ([(1.95, 1.2, 1, TRACKS)], ("pushed", 1.95)),
        ([(1.5, 1.2, 1, TRACKS), (0.6, 2.0, 1, TRACKS)], ("pushed", 2.1)),
        (12 * [(0.1, 1.2, 1, TRACKS), (0.2, 0, 1, TRACKS)], ("pushed", 1.2)),
        ([(2.05, 1.2, 1, TRACKS)], ("leaning", 2.05)),
        # Beyond its first level all the time, and beyond the one in force when the arm goes on.
        ([(0.1, 1.2, 1, TRACKS), (2.5, 1.2, 3, YIELDS), (0.1, 1.2, 1, TRACKS)], ("leaning", 2.7)),
        ([(0.48, 1.2, 1, YIELDS)], ("pushed", 0.48)),
        ([(0.52, 1.2, 1, YIELDS)], ("clamped", 0.52)),
        ([(3.0, 1.2, 1, YIELDS)], ("clamped", 3.0)),
        ([(0.2, 1.2, 1, TRACKS), (2.0, 1.1, 3, YIELDS), (0.1, 1.3, 1, TRACKS)], ("leaning", 2.3)),
        ([(0.2, 1.2, 1, TRACKS), (2.0, 1.1, 3, YIELDS), (0.1, 1.4, 1, TRACKS)], ("clamped", 2.3)),
    ],
)
def test_the_shortest_and_the_longest_of_each_word(
    phases: list[tuple[float, float, float, Mode]], expected: tuple[str, float]
) -> None:
    assert said(states_of(*phases)) == [expected]


@pytest.mark.parametrize(("after_s", "word"), [(0.0, "hit"), (0.14, "hit"), (0.3, "touched")])
def test_it_is_a_hit_if_the_collision_level_is_passed_at_once(after_s: float, word: str) -> None:
    states = states_of((0.35, 1.2, 1, TRACKS))
    past = protocol.Contact(
        joint=NAMES[6], torque=1.0, threshold=0.9, level="collision", side="gap"
    )
    at = round(100.0 * after_s)
    notice = Notice(kind="contact", text="", contact=past)
    states[at] = msgspec.structs.replace(states[at], notices=[notice])
    assert said(states)[0][0] == word


@pytest.mark.parametrize(
    ("modes", "word"),
    [((TRACKS, HOLDS), "load"), ((YIELDS, HOLDS), "load"), ((HOLDS, YIELDS), "pushed")],
)
def test_a_recognised_load_is_one_unless_the_arm_yields_to_a_hand_beside_it(
    modes: Sequence[Mode], word: str
) -> None:
    phases = [(0.3, 1.2, 1.0, mode) for mode in modes]
    assert said(states_of(*phases, recognised=LOAD))[0][0] == word


def test_an_arm_that_moves_on_its_way_has_not_given_way() -> None:
    states = [
        msgspec.structs.replace(one, link_position=(POSE + 0.01 * k).tolist())
        for k, one in enumerate(states_of(ONCE))
    ]
    assert said(states) == [("touched", 0.1)]
    yields = [msgspec.structs.replace(one, mode=YIELDS) for one in states]
    assert said(yields) == [("pushed", 0.1)]


def test_a_residual_below_its_level_elsewhere_makes_no_contact_longer() -> None:
    states = states_of(ONCE, (3.0, 0.0, 1, TRACKS), ONCE)
    for k, one in enumerate(states):
        states[k] = msgspec.structs.replace(one, residual=[0.7, *one.residual[1:]])
    assert said(states) == 2 * [("touched", 0.1)]


def test_a_contact_ends_with_the_sensing_and_one_that_goes_on_is_not_left_out() -> None:
    held = states_of(ONCE, (1.0, 1.2, 1, Mode.OFF), ONCE)
    assert said(held) == 2 * [("touched", 0.1)]
    assert said(held[:5]) == [("touched", 0.05)]


def test_contacts_of_a_recording(tmp_path: Path) -> None:
    snapshot, states = a_push()
    path = str(written(tmp_path / "a.mcap", [snapshot, *states]))
    answer = CliRunner().invoke(main, ["--json", "touches", path])
    assert answer.exit_code == 0, answer.output
    (said,) = [json.loads(line) for line in answer.output.splitlines()]
    assert (said["link"], said["decided"], said["word"]) == ("l_wrist", True, "pushed")
    off = [msgspec.structs.replace(state, mode=Mode.OFF) for state in states]
    path = str(written(tmp_path / "b.mcap", [snapshot, *off]))
    answer = CliRunner().invoke(main, ["touches", path])
    assert (answer.exit_code, answer.stdout) == (0, "")
    assert answer.stderr == f"{path}: no contact\n"


@pytest.mark.parametrize(("r", "mode", "says"), [(0, TRACKS, 0), (1, TRACKS, 1), (1, Mode.OFF, 0)])
def test_a_contact_that_is_present_at_the_start_is_reported(
    monkeypatch: pytest.MonkeyPatch, r: float, mode: Mode, says: int
) -> None:
    states = states_of(ONCE, mode=mode, thresholded=[0.0] * 6 + [r])
    client: Any = nullcontext(SimpleNamespace(subscribe=lambda: (CONTEXT, iter(states))))
    monkeypatch.setattr(Options, "connect", lambda _: client)
    assert CliRunner().invoke(main, ["touches"]).stderr.count("present already") == says


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({}, "touched"), ({"seconds": 0.5}, "pushed"), ({"moved_rad": 0.1}, "pushed"),
        ({"seconds": 3.0}, "leaning"), ({"seconds": 3.0, "unsteady": 0.5}, "pushed"),
        ({"hard": True, "seconds": 3.0}, "hit"), ({"held_s": 0.6, "hard": True}, "clamped"),
        ({"harder": 0.3, "seconds": 3.0}, "clamped"), ({"load_kg": 0.4, "held_s": 0.6}, "load"),
    ],
)  # fmt: skip
def test_the_table_of_words(fields: dict[str, Any], word: str) -> None:
    assert Contact.of(Evidence(1.0, **fields)).word == word


def goes_on(c: Configuration) -> Configuration:
    """It goes on in a hand that rests."""
    return msgspec.structs.replace(c, admittance=msgspec.structs.replace(c.admittance, probe=False))


def played(*hand: AnyAct, seconds: float = 8.0) -> list[State]:
    with lockstep_rig(hand=hand, configure=goes_on) as rig:
        rig.enable()
        rig.run(1.0)
        rig.permit("the test")
        rig.request(Event.START)
        return list(rig.states(seconds))


SHOULDER = "LShoulderPitch"


@pytest.mark.parametrize(
    ("hand", "word"),
    [
        ((Push(at_s=3.0, joint="LElbowYaw", torque=1.2, duration_s=0.12),), "touched"),
        ((Press(at_s=3.0, force=(0.0, -10.0, 0.0), duration_s=0.8),), "pushed"),
        ((Press(at_s=3.0, force=(0.0, -60.0, 0.0), rise_s=0.01, duration_s=0.2),), "hit"),
        ((Lean(at_s=3.0, joint=SHOULDER, torque=-2.5), Release(at_s=6.0)), "leaning"),
        ((Clamp(at_s=3.0, joints=(SHOULDER, "LElbowYaw")), Release(at_s=7.0)), "clamped"),
    ],
)
def test_hands_at_the_simulated_arm_in_words(hand: tuple[AnyAct, ...], word: str) -> None:
    found = list(contacts([CONTEXT, *played(*hand)]))
    assert [contact.word for contact in found] == [word]
    assert found[0].report()["word"] == word
    if word == "pushed":
        report = found[0].report()
        assert (report["link"], report["decided"]) == ("l_wrist", True)
        assert report["most_N"] == pytest.approx(10.0, abs=2.0)
        assert np.linalg.norm(np.subtract(report["point_m"], [0.07, 0.0, 0.0])) < report["doubt_m"]
