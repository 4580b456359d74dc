"""Command line of the bridge to ROS 2."""

import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from contactd_client.paths import view_socket_path
from programs.zenoh.contactd_zenoh import main

REFUSED = [
    (("--namespace", "left arm"), 78, "--namespace left arm: must be a slash and letters"),
    (("--connect", "localhost"), 78, "--connect localhost: must be a protocol, host and port"),
    (("--distro", "indigo"), 2, "'indigo' is not one of"),
    (("--domain", "233"), 2, "233 is not in the range"),
    (("--allow-arm",), 2, "--allow-arm needs --control-socket"),
    (("--config", "/nowhere"), 78, "contactd-zenoh: /nowhere: refused by Zenoh: "),
]


@pytest.mark.parametrize(("words", "status", "said"), REFUSED)
def test_wrong_options_are_reported(words: tuple[str, ...], status: int, said: str) -> None:
    result = CliRunner().invoke(main, words)
    assert result.exit_code == status
    assert said in result.output


def test_an_invalid_configuration_is_reported(tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text("{{")
    result = CliRunner().invoke(main, ["--config", str(file)])
    assert result.exit_code == 78
    assert f"contactd-zenoh: {file}: refused by Zenoh: " in result.output


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("programs.zenoh")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "xxhash", None)
    result = CliRunner().invoke(main, [])
    assert result.exit_code == 78
    assert result.output == ("contactd-zenoh: needs the extra `ros`: pip install 'contactd[ros]'\n")


def test_a_signal_ends_it_while_it_waits_for_a_router(fake_daemon: Any) -> None:
    words = [sys.executable, "-m", "programs.zenoh.contactd_zenoh", "--connect", "tcp/127.0.0.1:1"]
    words += ["--view-socket", str(view_socket_path(fake_daemon.path))]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    guard = threading.Timer(60.0, process.kill)
    guard.start()
    assert process.stdout is not None
    assert process.stdout.readline() == "contactd-zenoh: looking for a router: tcp/127.0.0.1:1\n"
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate()
    guard.cancel()
    assert (process.returncode, said) == (0, "")
