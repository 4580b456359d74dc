"""The order of a commissioning whose masses are wrong, typed live: masses, friction, thresholds."""

from functools import partial
from pathlib import Path

import pytest

from bench.rigs.lockstep import SINGLE_JOINT
from daemon.config import identified as file
from daemon.config.load import load_robot
from programs.clients.client import Client
from programs.identify import session
from tests.programs.identify.commissioned_arm import CommissionedArm, Written
from tests.programs.identify.typed_session import identify

ENTRY = {"date": "2026-01-02T03:04:05+00:00", "log": "0"}


def known(written: Written) -> None:
    written["joints"][0]["half_gap"] = 0.01


def to_be_found(written: Written) -> None:
    known(written)
    written["joints"][0].pop("known", None)


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CommissionedArm:
    """The single joint, wiring and gap known, whose bar is a fifth lighter than its URDF says."""
    # Of a machine that is busy with others, too.
    monkeypatch.setattr(session, "Client", partial(Client, timeout_s=60.0))
    arm = CommissionedArm(tmp_path, SINGLE_JOINT, change=to_be_found, really=known)
    urdf = arm.folder / "arm.urdf"
    urdf.write_text(urdf.read_text().replace('<mass value="1.0"/>', '<mass value="1.2"/>'))
    identify(arm.folder, "wiring", file.WiringEntry(follows=1.0, **ENTRY))
    identify(arm.folder, "gap", file.GapEntry(half_gap=0.01, confidence=0.0001, **ENTRY))
    return arm


def test_after_masses_friction_and_thresholds_run_to_the_end(arm: CommissionedArm) -> None:
    assert any("friction" in why for why in arm.arming_refusals())
    for step in (("masses", "--seconds", "20"), ("friction", "--seconds", "20")):
        assert arm.identify(*step), arm.output
    assert arm.identify("thresholds", "--seconds", "40"), arm.output
    robot = load_robot(arm.folder)
    assert robot.identified is not None
    joint = robot.identified.joints["joint"]
    assert joint.masses is not None
    assert joint.friction is not None
    assert joint.friction.rotor_inertia is not None
    assert joint.thresholds is not None
    assert arm.arming_refusals() == []
