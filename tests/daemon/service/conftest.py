"""An arm whose files a test may edit, and a control socket that a test polls."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.rigs.lockstep import ROMEO, SINGLE_JOINT
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from daemon.service.socket import ControlSocket
from tests.daemon.service.socket_rig import SocketRig
from tests.socket_peers import Dial


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """Folder of an arm, to be edited."""
    shutil.copytree(ROMEO, tmp_path / ROMEO.name)  # whose EDS the joint's drive refers to
    shutil.copytree(SINGLE_JOINT, tmp_path / "arm")
    return tmp_path / "arm"


@pytest.fixture
def served(arm: Path) -> Iterator[ServedDaemon]:
    """A daemon with that arm."""
    with served_daemon(arm.parent, arm) as opened:
        yield opened


@pytest.fixture
def on(served: ServedDaemon) -> ServedDaemon:
    """The same daemon, with its drives on."""
    served.rig.enable()
    return served


@pytest.fixture
def sockets(control: ControlSocket, dial: Dial) -> SocketRig:
    return SocketRig(control, dial)
