"""`contactd demo` as a person types it: simulator, daemon, guardian and recorder, in real time."""

import json
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize("arm", ["openarm_left", "beam_arm"])
def test_motors_with_their_guardian_are_shown_and_recorded(tmp_path: Path, arm: str) -> None:
    """Whether the story happens depends on how busy the machine is; that it begins does not."""
    file = tmp_path / "demo.mcap"
    words = ("demo", "--arm", arm, "--seconds", "25", "--json", "--record", str(file))
    ran = subprocess.run(
        [sys.executable, "-m", "programs.contactd.contactd", *words],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert ran.stdout, ran.stderr
    modes = [mode for _, mode in json.loads(ran.stdout)["modes"]]
    assert modes[:4] == ["off", "enabling", "holding", "tracking"]
    assert file.stat().st_size > 100_000
