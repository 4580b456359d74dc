"""Commands that each socket takes, all of them, and the path of the view socket."""

from pathlib import Path

import pytest

from contactd_client.paths import view_socket_path
from daemon.protocol.doors import DOORS, Door, refusal
from daemon.protocol.requests import AWAITED, COMMANDS

# Written out, so that the view socket refuses a new command until it is decided otherwise.
VIEW = {"disarm", "stop", "status", "subscribe"}
CONTROL_ALONE = {
    *("enable", "load", "start", "go", "follow", "target", "pause", "arm", "renew", "disable"),
    *("reset", "gain", "guide", "payload", "reload"),
}


@pytest.mark.parametrize("door", Door)
@pytest.mark.parametrize("command", COMMANDS)
def test_each_socket_takes_its_commands(door: Door, command: str) -> None:
    why = refusal(door, command)
    assert command in VIEW | CONTROL_ALONE, "add it to one of them"
    assert (why == "") == (door is Door.CONTROL or command in VIEW)
    if why:
        assert why == "the view socket takes only disarm, status, stop, subscribe"


def test_the_view_socket_takes_no_command_that_lets_the_arm_move() -> None:
    assert not AWAITED & DOORS[Door.VIEW].commands


@pytest.mark.parametrize(
    ("control", "view"),
    [
        ("/run/contactd/control", "/run/contactd/contactd-view.sock"),
        ("/run/user/1000/contactd.sock", "/run/user/1000/contactd-view.sock"),
        ("/tmp/contactd-1000.sock", "/tmp/contactd-1000-view.sock"),
        ("/tmp/left.sock", "/tmp/left-view.sock"),
    ],
)
def test_the_view_socket_is_beside_the_control_socket(control: str, view: str) -> None:
    assert view_socket_path(Path(control)) == Path(view)
