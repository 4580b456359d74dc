"""contactd-web.service beside contactd.service: its sandbox, its one socket, and what a user of the
view socket may."""

import contextlib
import json
import pwd
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from contactd_client.paths import view_socket_path
from daemon.protocol.doors import DOORS, Door
from daemon.protocol.requests import COMMANDS
from tests.system.stand import Service, Simulator, assert_is_confined, run, show, wait_for

PAGE = "contactd-web.service"
URL = "http://127.0.0.1:8420"
CONTROL = Path("/run/contactd/control")
VIEW = view_socket_path(CONTROL)
# Each request in turn, and what becomes of it: run as another user.
ASKS = """
import json, sys
from pathlib import Path
from programs.clients.client import Client
from common.errors import ContactdError
path, *commands = sys.argv[1:]
for command in commands:
    try:
        with Client(Path(path), 60.0) as client:
            reply = client.request(command)
        print(json.dumps([command, reply.ok, reply.message]))
    except ContactdError as error:
        print(json.dumps([command, None, str(error)]))
"""


def asked(path: Path, *commands: str, group: str) -> dict[str, tuple[bool | None, str]]:
    """By command, whether it was carried out (None: none was reached), and what was said: asked
    by user nobody, who is in this group alone."""
    done = subprocess.run(
        [sys.executable, "-c", ASKS, str(path), *commands],
        user="nobody",
        group=group,
        extra_groups=[],
        capture_output=True,
        text=True,
        check=True,
        cwd="/",
    )
    found = [json.loads(line) for line in done.stdout.splitlines()]
    return {command: (ok, text) for command, ok, text in found}


def fetch(path: str, command: str = "") -> str:
    """Answer of the page's server; a command is posted as the page's own script does."""
    headers = {"Origin": URL, "X-Contactd-Command": command} if command else {}
    method = "POST" if command else "GET"
    request = urllib.request.Request(f"{URL}{path}", headers=headers, method=method)
    with urllib.request.urlopen(request, timeout=60.0) as answer:
        return str(answer.read().decode())


def served() -> bool:
    with contextlib.suppress(OSError):
        return "<title>contactd" in fetch("/")
    return False


@pytest.fixture
def page(service: Service, simulator: Simulator) -> Iterator[Service]:
    """The unit as it is installed, beside a daemon that is ready."""
    service.start()
    run("systemctl", "start", PAGE, check=True)
    wait_for(served, "the page")
    yield service
    run("systemctl", "stop", PAGE)
    run("systemctl", "reset-failed", PAGE)


def test_the_process_is_confined_to_the_view_socket(page: Service) -> None:
    pid = int(show(PAGE, "MainPID"))
    assert_is_confined(pid, "contactd-web")
    mounts = [line.split() for line in Path(f"/proc/{pid}/mountinfo").read_text().splitlines()]
    writable = {mount[4] for mount in mounts if "rw" in mount[5].split(",")}
    assert "/" not in writable
    assert not any(path.startswith(("/usr", "/etc", "/home", "/opt")) for path in writable)


def test_the_page_stops_an_arm_in_motion(page: Service) -> None:
    page.enable()
    assert page.request("start").ok
    page.wait_for_mode("tracking")
    found = json.loads(fetch("/arms/0/stop", "stop"))
    # A slow machine has not seen it stand by then; that it was reached is what counts here.
    assert found["outcome"] in ("stands", "not seen to stand")
    status = page.wait_for_mode("holding")
    web = pwd.getpwnam("contactd-web").pw_uid
    assert f"stop by uid {web} " in status.cause
    assert "on behalf of the page at 127.0.0.1" in status.cause


def test_recordings_are_written_to_its_state_folder(page: Service) -> None:
    running = json.loads(fetch("/arms/0/record", "record"))["running"]
    path = Path("/var/lib/contactd-web/recordings") / running
    wait_for(lambda: path.exists() and path.stat().st_size > 1000, "a recording")
    fetch("/recordings/end", "end")
    assert path.read_bytes().startswith(b"\x89MCAP")
    assert path.stat().st_uid == pwd.getpwnam("contactd-web").pw_uid
    fetch(f"/recordings/{running}/delete", "delete")
    assert not path.exists()


def test_the_page_outlasts_the_daemon_and_finds_the_next(page: Service) -> None:
    pid = show(PAGE, "MainPID")
    page.stop()
    assert json.loads(fetch("/arms/0/stop", "stop"))["outcome"] == "not reached"
    page.start()
    wait_for(lambda: "not reached" not in fetch("/arms/0/stop", "stop"), "the next daemon")
    assert (show(PAGE, "MainPID"), show(PAGE, "NRestarts")) == (pid, "0")


def test_a_user_of_the_view_socket_may_stop_and_not_control(page: Service) -> None:
    page.enable()
    found = asked(VIEW, *COMMANDS, group="contact-view")
    taken = {command for command, (ok, _) in found.items() if ok}
    assert taken == DOORS[Door.VIEW].commands
    for command in set(found) - taken:
        why = f"{command}: the view socket takes only disarm, status, stop, subscribe"
        assert found[command] == (False, why)
    outcome, text = asked(CONTROL, "stop", group="contact-view")["stop"]
    assert outcome is None
    assert text.startswith("you may not use /run/contactd/control")
    # Others reach neither.
    for path in (CONTROL, VIEW):
        assert asked(path, "status", group="nogroup")["status"][0] is None


def test_with_its_port_taken_starts_are_repeated_without_a_limit() -> None:
    with socket.create_server(("127.0.0.1", 8420), reuse_port=False) as taken:
        for _ in range(7):
            run("systemctl", "restart", PAGE)
            wait_for(lambda: show(PAGE, "SubState") == "auto-restart", "the next try")
            assert show(PAGE, "Result") != "start-limit-hit"
        taken.close()
    wait_for(served, "the page, by itself")
    run("systemctl", "stop", PAGE, check=True)
    run("systemctl", "reset-failed", PAGE)
