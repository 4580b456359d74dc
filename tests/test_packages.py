"""Contents of wheel and source archive: all of the project, and nothing of who builds them."""

import shutil
import subprocess
from pathlib import Path

import pytest
from hatchling.builders.plugin.interface import BuilderInterface
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder

ROOT = Path(__file__).parents[1]


def packed(builder: type[BuilderInterface], root: Path) -> set[str]:
    """Files that a build takes from a clone."""
    return {file.relative_path for file in builder(str(root)).recurse_included_files()}


def test_the_source_archive_has_every_file_of_the_repository() -> None:
    listed = subprocess.run(
        ["git", "-C", ROOT, "ls-files", "-z"], capture_output=True, text=True, check=False
    )
    if listed.returncode:
        pytest.skip("no clone")
    tracked = {name for name in listed.stdout.split("\0") if (ROOT / name).is_file()}
    assert tracked - packed(SdistBuilder, ROOT) == set()


@pytest.mark.parametrize("folder", ["clone", "build/release"])  # .gitignore has a pattern `build/`
@pytest.mark.parametrize("builder", [SdistBuilder, WheelBuilder])
def test_what_the_owner_of_an_arm_keeps_in_the_clone_stays_there(
    tmp_path: Path, builder: type[BuilderInterface], folder: str
) -> None:
    clone = tmp_path / folder
    clone.mkdir(parents=True)
    for name in ("pyproject.toml", ".gitignore"):
        shutil.copy(ROOT / name, clone)
    for theirs in (
        "configs/my_arm/config.yaml",
        "configs/my_arm/identified.yaml",
        "configs/desk_arm/identify/strokes.mcap",
        "touch.mcap",
        "move.csv",
        "keys/arm.pem",
        "estimator/compiled/kernel.cpython-311-x86_64-linux-gnu.so",
        "estimator/compiled/compiled.json",
        "bench/out/hand.json",
    ):
        (clone / theirs).parent.mkdir(parents=True, exist_ok=True)
        (clone / theirs).touch()
    example = clone / "configs/desk_arm/config.yaml"
    example.touch()
    ours = {"pyproject.toml", ".gitignore", "configs/desk_arm/config.yaml"}
    assert packed(builder, clone) - ours == set()
    assert "configs/desk_arm/config.yaml" in packed(builder, clone)
