"""`contactd identify` on a live arm, in lockstep: stopped, touched, and left by a drive."""

import itertools
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from bench.rigs.lockstep import ROMEO, SINGLE_JOINT
from bench.rigs.served_daemon import ServedDaemon
from common.errors import ControlError, LogError
from daemon.config import identified as file
from daemon.config.load import load_robot
from daemon.modes.table import Mode
from daemon.protocol.state import State
from identification.motion_log import MotionLog
from programs.contactd import contactd
from programs.identify.hand import Hand
from programs.identify.measured import read_measured
from programs.identify.session import Session, followed
from tests.programs.identify.commissioned_arm import CommissionedArm
from tests.programs.identify.typed_session import (
    MOTION_S,
    TypedCommand,
    identify,
    stopped,
    wired_joint,
)

APPROACH_S = 0.9
"""Time of the single joint from where it hangs to where its excitation begins."""


@pytest.fixture
def arm(tmp_path: Path) -> CommissionedArm:
    return wired_joint(tmp_path)


@pytest.fixture
def served(arm: CommissionedArm) -> Iterator[ServedDaemon]:
    with arm.served() as served:
        served.rig.enable()
        yield served


def recorded(part: Path) -> MotionLog:
    """Its contents."""
    return read_measured([part], load_robot(SINGLE_JOINT).configuration).log


@pytest.mark.parametrize(
    "words",
    [*(("wiring",), ("gap",), ("gap", "--by-hand"), ("masses", "--seconds", "20")),
     *(("friction", "--seconds", "20"), ("payload", "cup"), ("thresholds",))],
)  # fmt: skip
def test_ctrl_c_leaves_the_arm_holding_and_nothing_half_written(
    arm: CommissionedArm, served: ServedDaemon, words: tuple[str, ...]
) -> None:
    before = (arm.folder / "identified.yaml").read_bytes()
    status, said = stopped(served, *words)
    assert status == 1
    assert "stopped by you; the arm is holding" in said
    assert served.rig.mode is Mode.HOLDING
    assert (arm.folder / "identified.yaml").read_bytes() == before
    assert [path.name for path in arm.folder.glob(".identified*")] == []
    (part,) = (arm.folder / "identify").glob("*.part01.mcap")
    assert recorded(part).duration_s > MOTION_S - 0.5


def test_a_signal_to_the_process_leaves_the_arm_holding_and_the_next_is_ignored(
    arm: CommissionedArm, served: ServedDaemon
) -> None:
    command = [sys.executable, "-m", "programs.contactd.contactd", "identify", "friction"]
    with subprocess.Popen(
        [*command, "--seconds", "20", "--yes", "--socket", str(served.path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:

        def tick() -> bool:
            served.tick()
            if not served.service.control.readers:
                time.sleep(0.002)
            return served.rig.mode is Mode.TRACKING

        in_motion = 0
        while process.poll() is None and in_motion < 100 * MOTION_S:
            in_motion += tick()
        process.send_signal(signal.SIGINT)
        while process.poll() is None and tick():
            pass
        process.send_signal(signal.SIGHUP)
        while process.poll() is None:
            tick()
        assert process.stdout is not None
        said = " ".join(process.stdout.read().split())
    assert process.returncode == 1, said
    assert "stopped by you; the arm is holding" in said
    assert "Traceback" not in said
    assert served.rig.mode is Mode.HOLDING
    (part,) = (arm.folder / "identify").glob("*.part01.mcap")
    assert recorded(part).duration_s > MOTION_S - 0.5


def test_friction_goes_on_from_where_it_was_stopped(
    arm: CommissionedArm, served: ServedDaemon
) -> None:
    """36 s are two turns of the excitation; for what remains after 5 s one is enough. Before both
    there is the way to where it begins."""
    stopped(served, "friction", "--seconds", "36", after_s=5.0 + APPROACH_S)
    (part,) = (arm.folder / "identify").glob("friction*.mcap")
    already = recorded(part).duration_s - APPROACH_S
    assert 4.4 < already < 8.0
    typed = TypedCommand(served, "friction", "--seconds", "36")
    status, said = typed.ends()
    assert status == 0, said
    (measured,) = re.findall(r"part01\.mcap (\d+) s of 36 s were measured before", said)
    assert int(measured) == pytest.approx(already, abs=1.0)
    assert typed.ticks_in_motion < 4000
    first, second = sorted((arm.folder / "identify").glob("friction-*.mcap"))
    assert recorded(first).duration_s == pytest.approx(already + APPROACH_S)
    assert recorded(second).duration_s == pytest.approx(typed.ticks_in_motion / 100, abs=0.6)


def test_a_hand_goes_on_with_the_borders_that_it_met_before(
    make_state: Callable[..., State],
) -> None:
    """Thirteen visits in each of two sittings, the motor elsewhere by the second."""
    ends = np.resize([0.02, -0.02], 14)
    phi = np.concatenate([np.linspace(a, b, 41)[1:] for a, b in itertools.pairwise(ends)])
    phi = np.repeat(phi.reshape(13, 40), [1] * 39 + [60], axis=1).ravel()
    times, zero = 0.01 * np.arange(len(phi)), np.zeros((len(phi), 1))
    pressed = -np.sign(phi) * (np.abs(phi) > 0.019)
    before = MotionLog(("joint",), times, pressed[:, None], phi[:, None], zero, zero)
    hands = [Hand(0, 1.0, "joint"), Hand(0, 1.0, "joint", before)]
    for tick, x in enumerate(phi):
        state = msgspec.structs.replace(
            make_state(tick),
            current=[float(pressed[tick])],
            link_position=[0.3 + x],
            motor_velocity=[0.0],
            motor_position=[0.3],
        )
        for hand in hands:
            hand.add(state)
    assert hands[0].gap is not None
    assert hands[1].gap is not None
    assert hands[0].gap.crossings <= 12
    assert hands[1].gap.crossings >= 20
    assert hands[1].gap.half_gap == pytest.approx(0.02, abs=2e-4)
    assert (hands[0].done, hands[1].done) == (False, True)


def test_a_refused_start_leaves_no_recording(arm: CommissionedArm) -> None:
    (arm.folder / "identified.yaml").unlink()
    with arm.served() as served:
        served.rig.enable()
        status, said = TypedCommand(served, "friction", "--seconds", "20").ends()
    assert status == 1
    assert "the wiring was not checked" in said
    assert list((arm.folder / "identify").iterdir()) == []


def test_where_nothing_can_be_recorded_nothing_moves(
    arm: CommissionedArm, served: ServedDaemon
) -> None:
    (arm.folder / "identify").touch()
    typed = TypedCommand(served, "friction", "--seconds", "20")
    status, said = typed.ends()
    assert (status, typed.ticks_in_motion) == (65, 0)
    assert "cannot record in " in said


def refused(
    arm: CommissionedArm, served: ServedDaemon, part: Path, step: str, live: str, log: str
) -> None:
    """A step is, on the arm before anything moves, and on a recording of it."""
    typed = TypedCommand(served, step)
    status, said = typed.ends()
    assert (status, typed.ticks_in_motion) == (78, 0)
    assert live in said
    words = ["identify", step, "--config", str(arm.folder), "--log", str(part)]
    result = CliRunner().invoke(contactd.main, words)
    assert result.exit_code == 65
    assert log in result.output


def test_samples_of_another_wiring_are_refused(arm: CommissionedArm, served: ServedDaemon) -> None:
    stopped(served, "friction", "--seconds", "20")
    (part,) = (arm.folder / "identify").glob("*.mcap")
    text = (arm.folder / "config.yaml").read_text()
    (arm.folder / "config.yaml").write_text(text.replace("gear: 100", "gear: 110"))
    refused(arm, served, part, "friction", live="changed since the daemon read it",
            log="was recorded with other drives, another wiring or another period")  # fmt: skip
    with pytest.raises(LogError, match="is of another arm, with the joints joint"):
        read_measured([part], load_robot(ROMEO).configuration)


def test_thresholds_are_those_of_the_values_in_force(
    arm: CommissionedArm, served: ServedDaemon
) -> None:
    stopped(served, "thresholds")
    (part,) = (arm.folder / "identify").glob("*.mcap")
    gap = file.GapEntry(date="2026-01-02T03:04:05+00:00", log="0", half_gap=0.025, confidence=0.0)
    identify(arm.folder, "gap", gap)
    refused(arm, served, part, "thresholds", live="its residuals use outdated ones: `contactctl",
            log="than those in force: `contactctl reload`, then record again")  # fmt: skip


ENDED = "identify friction came to its end"


@pytest.mark.parametrize(
    ("modes", "answer", "seen"),
    [
        (["holding", "tracking", "tracking", f"holding:{ENDED}"], "", 2),
        (["tracking", "tracking", "tracking", "tracking"], "", 3),  # `each` has enough
        (["holding", "tracking", "holding:paused"], "the arm is holding: paused", 1),
        (["holding", "tracking", "stopping:touch", "holding"], "the arm is stopping: touch", 1),
        # A fault in the tick of the start: it never tracked.
        (["holding", "faulted:drive lost", "faulted"], "the arm is faulted: drive lost", 0),
        ([f"holding:{ENDED}", "tracking"], "the daemon ended", 1),  # that was another
    ],
)
def test_how_a_motion_ends(
    make_state: Callable[..., State], modes: list[str], answer: str, seen: int
) -> None:
    def states() -> Iterator[State]:
        for tick, mode in enumerate(modes):
            name, _, cause = mode.partition(":")
            yield msgspec.structs.replace(make_state(tick), mode=name, cause=cause)

    saw: list[State] = []

    def each(state: State) -> bool:
        saw.append(state)
        return len(saw) == 3

    assert followed(states(), each, pytest.fail) == answer
    assert len(saw) == seen


def test_a_lost_drive_ends_the_step_and_is_named(
    arm: CommissionedArm, served: ServedDaemon
) -> None:
    before = (arm.folder / "identified.yaml").read_bytes()
    typed = TypedCommand(served, "friction", "--seconds", "20")
    typed.moves()
    served.rig.arm.drives[0].transmit = lambda: None  # type: ignore[method-assign]
    status, said = typed.ends()
    assert status == 1
    assert "the arm is faulted: " in said
    assert "joint" in said.split("the arm is faulted: ")[1]
    assert (arm.folder / "identified.yaml").read_bytes() == before


def test_a_touch_is_reported_at_once_and_left_out(
    arm: CommissionedArm, served: ServedDaemon
) -> None:
    typed = TypedCommand(served, "friction", "--seconds", "20")
    typed.moves(8.0)
    served.rig.arm.external_torque[0] = 1.5
    typed.moves(8.5)
    served.rig.arm.external_torque[0] = 0.0
    status, said = typed.ends()
    assert status == 0, said
    assert "if that was you, hands off; it is discarded" in said
    assert "s discarded: joint was touched" in said
    found = load_robot(arm.folder).configuration.joints[0].friction
    true = served.rig.arm.plant.parameters.coulomb.sum()
    assert found.motor_coulomb + found.link_coulomb == pytest.approx(true, rel=0.04)


@pytest.mark.parametrize("end", [Mode.FAULTED, Mode.OFF])
def test_an_arm_that_will_not_hold_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: Mode
) -> None:
    modes = iter([Mode.STOPPING, Mode.STOPPING, end])

    def ask_status() -> SimpleNamespace:
        return SimpleNamespace(mode=next(modes), cause="apart", armed=False)

    daemon = SimpleNamespace(ask_status=ask_status)
    monkeypatch.setattr("programs.identify.session.Client", lambda socket: daemon)
    session = Session(tmp_path, tmp_path, print, lambda off: True)
    with pytest.raises(ControlError, match=f"does not hold: {end}, apart"):
        session.hold()
