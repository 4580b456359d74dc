"""An arm whose files a test may edit."""

import shutil
from pathlib import Path

import pytest

from bench.rigs.lockstep import ROMEO, SINGLE_JOINT


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """A folder of its own, to be edited."""
    shutil.copytree(ROMEO, tmp_path / ROMEO.name)  # whose EDS the joint's drive refers to
    shutil.copytree(SINGLE_JOINT, tmp_path / "arm")
    return tmp_path / "arm"
