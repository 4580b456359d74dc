"""Files by a configured or derived path: what is not a regular file is refused, not waited for."""

import os
import shutil
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from bench.rigs.lockstep import SINGLE_JOINT
from common import regular_file
from common.errors import ContactdError
from common.regular_file import open_regular, read_text
from daemon.config.load import load_robot
from daemon.motion.trajectory_file import read_trajectory
from drivers.canopen.boot.data_sheet import load_data_sheet
from estimator.model import Model
from programs.clients.log_reader import read_log
from programs.identify.csv_log import read_csv
from simulator.hand_script import read_script
from simulator.objects import entries


def test_a_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"one\r\ntwo \xc3\xa9")
    assert read_text(path) == "one\ntwo é"
    link = tmp_path / "link"
    link.symlink_to(path)
    assert read_text(link) == "one\ntwo é"
    with open_regular(path, follow=False) as stream:
        assert stream.read() == path.read_bytes()
        assert stream.name == str(path)
    with pytest.raises(OSError, match="is a link, not a file"):
        open_regular(link, follow=False)
    with pytest.raises(FileNotFoundError):
        open_regular(tmp_path / "none")
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)


@pytest.mark.usefixtures("impatient")
def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    fifo, bound, device = tmp_path / "fifo", tmp_path / "socket", Path("/dev/zero")
    os.mkfifo(fifo)
    with socket.socket(socket.AF_UNIX) as opened:
        opened.bind(str(bound))
    held = len(os.listdir("/proc/self/fd"))
    for path in (fifo, bound, device):
        with pytest.raises(OSError, match="is not a regular file"):
            open_regular(path)
        with pytest.raises(OSError, match="is not a regular file"):
            read_text(path)
    assert len(os.listdir("/proc/self/fd")) == held


def test_a_text_without_end_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regular_file, "LARGEST_TEXT_BYTES", 2 << 20)
    path = tmp_path / "large"
    path.touch()
    os.truncate(path, 2 << 20)
    assert len(read_text(path)) == 2 << 20
    os.truncate(path, (2 << 20) + 1)
    with pytest.raises(OSError, match="is larger than 2 MB"):
        read_text(path)


READERS: dict[str, Callable[[Path], object]] = {
    "recording": lambda path: list(read_log(path)),
    "measurements": lambda path: read_csv(path, ["joint"], {}),
    "trajectory": lambda path: read_trajectory(path, ["joint"]),
    "configuration": load_robot,
    "data sheet": load_data_sheet,
    "simulated data sheet": lambda path: entries(path, 1),
    "script": read_script,
    "URDF": lambda path: Model(path, ("joint",)),
}


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("name", list(READERS))
def test_no_reader_waits_for_a_fifo(tmp_path: Path, name: str) -> None:
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    with pytest.raises(ContactdError, match=f"{fifo}.*is not a regular file"):
        READERS[name](fifo)


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("name", ["config.yaml", "arm.urdf", "identified.yaml"])
def test_no_part_of_a_robot_is_waited_for(tmp_path: Path, name: str) -> None:
    shutil.copytree(SINGLE_JOINT.parent, tmp_path / "configs")
    folder = tmp_path / "configs" / SINGLE_JOINT.name
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    with pytest.raises(ContactdError, match=f"{name}.*is not a regular file"):
        load_robot(folder)


def test_a_link_to_nothing_is_not_as_if_nothing_had_been_identified(tmp_path: Path) -> None:
    shutil.copytree(SINGLE_JOINT.parent, tmp_path / "configs")
    folder = tmp_path / "configs" / SINGLE_JOINT.name
    (folder / "identified.yaml").unlink(missing_ok=True)
    load_robot(folder)
    (folder / "identified.yaml").symlink_to(tmp_path / "nothing")
    with pytest.raises(ContactdError, match=r"identified\.yaml: cannot be read: No such file"):
        load_robot(folder)
