"""Errors of a link's encoder with each turn: found live, written, taken off, recorded, replayed."""

import threading
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bench.rigs.lockstep import SINGLE_JOINT
from daemon.config import identified as file
from daemon.config.load import Robot, load_robot
from daemon.protocol.state import Snapshot, State
from programs.clients.client import Client
from programs.clients.log_reader import read_log
from programs.clients.recorder import record
from programs.clients.replay import Replay, replay
from programs.identify import session
from programs.simulate.simulated_robot import describe
from simulator.description import ArmDescription, EncoderError
from simulator.truth import SimulationFile
from tests.programs.identify.commissioned_arm import CommissionedArm, Written
from tests.programs.identify.typed_session import identify

ERROR = 0.002
"""Amplitude of what the link's encoder errs, twice in a turn [rad]."""

AXIS = 'axis xyz="0 1 0"'


def erring(robot: Robot, simulation: SimulationFile) -> ArmDescription:
    """The single joint, whose link encoder errs."""
    arm = describe(robot, simulation)
    (joint,) = arm.joints
    twice = EncoderError(encoder="link", order=2, amplitude=ERROR, phase=0.7)
    return replace(arm, joints=(replace(joint, encoder_errors=(twice,)),))


def small_gap(written: Written) -> None:
    written["joints"][0]["half_gap"] = 0.01
    written["estimator"] = written.get("estimator", {}) | {"motor_position": "measured"}


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CommissionedArm:
    # Of a machine that is busy with others, too.
    monkeypatch.setattr(session, "Client", partial(Client, timeout_s=60.0))
    arm = CommissionedArm(
        tmp_path, SINGLE_JOINT, described=erring, change=small_gap, really=small_gap
    )
    for folder in (arm.folder, arm.truth):
        urdf = folder / "arm.urdf"  # turned upright: gravity bends nothing as an encoder errs
        urdf.write_text(urdf.read_text().replace(AXIS, 'axis xyz="0 0 1"'))
    wired = file.WiringEntry(date="2026-01-02T03:04:05+00:00", log="0", follows=1.0)
    identify(arm.folder, "wiring", wired)
    return arm


def worst(arm: CommissionedArm, path: Path) -> float:
    """Largest error of the link's position, while the arm swings and is recorded [rad]."""
    with arm.served() as served:
        served.rig.enable()
        assert served.contactctl("start").exit_code == 0
        off: list[float] = []

        def enough() -> bool:
            return len(off) >= 400

        def watch() -> None:
            record(lambda: Client(served.path, timeout_s=60.0), path, stop=enough)

        watching = threading.Thread(target=watch)
        watching.start()
        while watching.is_alive():
            served.tick()
            if served.service.control.readers:
                samples, plant = served.rig.samples, served.rig.arm.plant
                off.append(float(samples.link_position[0] - plant.q[0]))
    return float(np.abs(off).max())


def test_a_correction_is_found_written_used_and_replayed(
    arm: CommissionedArm, tmp_path: Path
) -> None:
    before = worst(arm, tmp_path / "before.mcap")
    assert arm.identify("encoders"), arm.output
    identified = load_robot(arm.folder).identified
    assert identified is not None
    entry = identified.joints["joint"].encoders
    assert entry is not None
    (found,) = entry.link_correction
    assert found.order == 2
    after = worst(arm, tmp_path / "after.mcap")
    assert before > 0.9 * ERROR
    assert after < 0.1 * ERROR

    # Replayed, the corrected samples give the same estimates to the last bit.
    states = [m for m in read_log(tmp_path / "after.mcap") if isinstance(m, State)]
    begun = next(m for m in read_log(tmp_path / "after.mcap") if isinstance(m, Snapshot))
    assert "link_correction" in begun.identified
    assert replay(tmp_path / "after.mcap") == Replay(len(states), 0, 1, None, "")
