"""Path of the daemon's configuration, asked for from other folders than its own."""

import shutil
from pathlib import Path

import pytest

from bench.rigs.lockstep import SINGLE_JOINT
from bench.rigs.served_daemon import served_daemon
from daemon.config.load import load_robot
from programs.clients.client import Client
from programs.identify.identification import from_here
from tests.programs.identify.commissioned_arm import CommissionedArm
from tests.programs.identify.typed_session import wired_joint


@pytest.fixture
def arm(tmp_path: Path) -> CommissionedArm:
    return wired_joint(tmp_path)


def test_status_names_the_whole_path(
    arm: CommissionedArm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with served_daemon(tmp_path, Path("my_arm")) as served:
        monkeypatch.chdir("/")
        with Client(served.path) as client:
            status = served.ask(client, "status").status
    assert status is not None
    assert status.configuration == str(arm.folder.resolve() / "config.yaml")


def test_a_linked_configuration_keeps_its_folder(arm: CommissionedArm, tmp_path: Path) -> None:
    """The folder may be a link, too."""
    written = (arm.folder / "config.yaml").rename(tmp_path / "written.yaml")
    (arm.folder / "config.yaml").symlink_to(written)
    (tmp_path / "link").symlink_to(arm.folder)
    assert load_robot(tmp_path / "link").place() == arm.folder.resolve() / "config.yaml"


def test_identify_writes_to_the_daemons_folder_from_wherever_it_is_typed(
    arm: CommissionedArm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where another arm has the same path from there."""
    (elsewhere := tmp_path / "elsewhere").mkdir()
    other = shutil.copytree(SINGLE_JOINT, elsewhere / "my_arm")
    before = (other / "identified.yaml").read_bytes()
    (arm.folder / "identified.yaml").unlink()
    monkeypatch.chdir(tmp_path)
    with served_daemon(tmp_path, Path("my_arm"), truth=arm.truth) as served:
        served.rig.enable()
        monkeypatch.chdir(elsewhere)
        result = served.contactd("identify", "wiring", "--yes")
    assert result.exit_code == 0, result.output
    written = arm.folder.resolve() / "identified.yaml"
    assert f"written to {written}: joint" in result.output
    assert written.exists()
    assert (other / "identified.yaml").read_bytes() == before


@pytest.mark.parametrize(
    ("here", "shown"),
    [("arms", "left/config.yaml"), ("arms/left", "config.yaml"), ("other", ""), ("/", "")],
)
def test_a_path_is_shown_as_it_would_be_typed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, here: str, shown: str
) -> None:
    """From elsewhere it is whole, and in the root's folder, too."""
    for name in ("arms/left", "other"):
        (tmp_path / name).mkdir(parents=True)
    path = tmp_path.resolve() / "arms/left/config.yaml"
    monkeypatch.chdir(tmp_path / here)
    assert str(from_here(path)) == (shown or str(path))
