"""Two commands that write to one `identified.yaml`."""

import fcntl
import os
import shutil
from datetime import UTC, datetime
from pathlib import Path

import pytest
from rich.console import Console

from bench.rigs.lockstep import ROMEO
from common.errors import ConfigurationError
from daemon.config.identified import GapEntry
from daemon.config.load import load_robot
from programs.identify.identification import Identification
from programs.identify.step import Line, Outcome

A, B = "LShoulderPitch", "LElbowRoll"


def test_what_another_command_wrote_meanwhile_stays(tmp_path: Path, monkeypatch) -> None:
    folder = Path(shutil.copytree(ROMEO, tmp_path / "arm"))
    both = [Identification(load_robot(folder), Console(quiet=True), dry=False) for _ in range(2)]
    for one, joint in zip(both, (A, B), strict=True):
        entry = GapEntry(date=str(datetime.now(UTC)), log="", half_gap=0.0123, confidence=0.0)
        line = Line(joint, "clear", good=True)
        one.conclude("gap", Outcome(lines=[line], entries={joint: entry}))
    joints = load_robot(folder).identified.joints
    assert [joints[name].gap.half_gap for name in (A, B)] == [0.0123, 0.0123]
    before = (folder / "identified.yaml").read_bytes()
    monkeypatch.setattr("common.new_file._WAIT_S", 0.1)
    handle = os.open(folder, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    with pytest.raises(ConfigurationError, match=r"identified\.yaml is locked by another command"):
        both[0].conclude("gap", Outcome(lines=[line], entries={B: entry}))
    os.close(handle)
    assert (folder / "identified.yaml").read_bytes() == before
