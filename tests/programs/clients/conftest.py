"""A socket where nothing is answered unless a test does it."""

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture
def listener(tmp_path: Path) -> Iterator[socket.socket]:
    """A listening socket that is not polled."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as opened:
        opened.bind(str(tmp_path / "listening"))
        opened.listen(8)
        yield opened
