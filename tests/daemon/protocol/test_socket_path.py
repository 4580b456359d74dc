"""Path and permissions of the control socket, and files that it never replaces."""

import grp
import os
import socket
import stat
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import pytest

from common.errors import ControlError
from contactd_client import paths
from contactd_client.paths import default_socket_path, usual_socket_path, view_socket_path
from daemon.protocol.doors import DOORS, Door
from daemon.protocol.replies import Reply
from daemon.service.socket import ControlSocket

ANOTHER = """
import contextlib, os, socket, sys
door = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
os.setgroups(eval(sys.argv[2]))
os.setgid(65534)
os.setuid(65534)
door.connect(sys.argv[1])
for step in (lambda: door.send(b'{"command": "disarm"}'), lambda: print(door.recv(1000).decode())):
    try:
        step()
    except ConnectionError:
        print(door.recv(1000).decode())
        break
"""


def test_the_kernel_is_asked_who_it_is() -> None:
    """Although a user has opened the socket file to all."""
    if os.getuid() != 0:
        pytest.skip("only root may become another user")
    said = []
    # pytest's own folders are closed to others.
    with (
        tempfile.TemporaryDirectory() as folder,
        ControlSocket(Path(folder) / "control") as control,
    ):
        Path(folder).chmod(0o755)
        control.path.chmod(0o666)
        for groups in ("[]", f"[{control.path.stat().st_gid}]"):
            command = [sys.executable, "-c", ANOTHER, str(control.path), groups]
            process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            while process.poll() is None:
                control.poll(lambda request, peer: Reply(ok=True))
                time.sleep(0.001)
            said.append(process.communicate()[0])
    refused, served = said
    assert "you are not in the group of" in refused
    assert '"ok":true' in served


def test_permissions(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    previous = os.umask(0)
    try:
        with ControlSocket(tmp_path / "control") as control:
            mode = control.path.stat().st_mode
            group = control.path.stat().st_gid
    finally:
        os.umask(previous)
    assert stat.S_ISSOCK(mode)
    assert stat.S_IMODE(mode) == 0o660
    try:
        assert group == grp.getgrnam("contact").gr_gid
    except KeyError:
        assert group == os.getgid()
        assert caplog.text.count("group contact does not exist") == 1


def test_group_is_set_where_it_exists(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if os.getuid() != 0:
        pytest.skip("only root may give a file to any group")
    other = next(g for g in grp.getgrall() if g.gr_gid != os.getgid())
    rule = replace(DOORS[Door.CONTROL], group=other.gr_name)
    monkeypatch.setitem(DOORS, Door.CONTROL, rule)
    with ControlSocket(tmp_path / "control") as control:
        assert control.path.stat().st_gid == other.gr_gid


def test_live_daemon_is_left_alone(control: ControlSocket) -> None:
    with pytest.raises(ControlError, match=rf"another contactd \(pid {os.getpid()}\) serves"):
        ControlSocket(control.path)
    assert control.path.is_socket()


def test_stale_socket_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "control"
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as dead:
        dead.bind(str(path))
        dead.listen()
    assert path.is_socket()
    with ControlSocket(path), socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as client:
        client.connect(str(path))
    assert not path.exists()


def test_socket_file_of_a_successor_is_left(tmp_path: Path) -> None:
    first = ControlSocket(tmp_path / "control")
    first.path.rename(tmp_path / "moved")
    view_socket_path(first.path).rename(tmp_path / "moved-view")
    with ControlSocket(tmp_path / "control") as second:
        first.close()
        assert second.path.is_socket()
        assert view_socket_path(second.path).is_socket()


@pytest.mark.parametrize("kind", ["file", "directory", "link"])
def test_only_a_socket_is_ever_removed(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "control"
    if kind == "file":
        path.write_text("mine")
    elif kind == "directory":
        path.mkdir()
    else:
        path.symlink_to("/etc/passwd")
    with pytest.raises(ControlError, match="not a socket"):
        ControlSocket(path)
    assert path.lstat()


@pytest.mark.parametrize("path", ["/nonexistent/control", "/tmp/" + "x" * 200])
def test_impossible_path(path: str) -> None:
    with pytest.raises(ControlError, match="cannot listen at /"):
        ControlSocket(Path(path))


def test_default_path(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CONTACTD_SOCKET", "/somewhere/else")
    assert default_socket_path() == Path("/somewhere/else")
    monkeypatch.delenv("CONTACTD_SOCKET")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(Path, "is_dir", lambda self: str(self) == "/run/contactd")
    assert default_socket_path() == Path("/run/contactd/control")
    monkeypatch.setattr(Path, "is_dir", lambda self: self == tmp_path)
    assert default_socket_path() == tmp_path / "contactd.sock"
    monkeypatch.setenv("XDG_RUNTIME_DIR", "")
    monkeypatch.setattr(os, "getuid", lambda: 987_654)
    assert default_socket_path() == Path("/tmp/contactd-987654.sock")


def test_clients_look_for_the_installed_service_also_before_it_ever_ran(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("CONTACTD_SOCKET", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(paths, "SERVICE_SOCKET", tmp_path / "run/control")
    monkeypatch.setattr(paths, "UNIT_FOLDERS", (tmp_path / "a", tmp_path / "b"))
    mine = tmp_path / "contactd.sock"
    assert usual_socket_path() == mine
    (tmp_path / "b").mkdir()
    (tmp_path / "b/contactd.service").touch()
    assert usual_socket_path() == tmp_path / "run/control"
    mine.touch()
    assert usual_socket_path() == mine, "a daemon of one's own is nearer"
    (tmp_path / "run").mkdir()
    assert usual_socket_path() == tmp_path / "run/control"
    monkeypatch.setenv("CONTACTD_SOCKET", "/somewhere/else")
    assert usual_socket_path() == Path("/somewhere/else")


def test_a_folder_of_another_user_has_no_daemon_of_ones_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """`su` leaves the folder of the user before."""

    def closed(path: Path) -> bool:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.delenv("CONTACTD_SOCKET", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(paths, "SERVICE_SOCKET", tmp_path / "run/control")
    monkeypatch.setattr(paths, "UNIT_FOLDERS", ())
    monkeypatch.setattr(Path, "exists", closed)
    assert usual_socket_path() == tmp_path / "contactd.sock"


def test_default_path_of_another_user_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    trap = Path("/tmp/contactd-987654.sock")
    monkeypatch.delenv("CONTACTD_SOCKET", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", "")
    monkeypatch.setattr(Path, "is_dir", lambda self: False)
    monkeypatch.setattr(os, "getuid", lambda: 987_654)
    trap.symlink_to("/nowhere")
    try:
        with pytest.raises(ControlError, match="not to you"):
            default_socket_path()
    finally:
        trap.unlink()
