"""Commands that each door takes, all of them, and the path of the view socket."""

from pathlib import Path

import pytest

from contactd_client.paths import view_socket_path
from daemon.protocol.doors import DOORS, Door, refusal
from daemon.protocol.requests import AWAITED, COMMANDS

# Written out, so that a new command is refused by the view door until it is decided otherwise.
TAKEN = {
    "enable": {Door.CONTROL},
    "load": {Door.CONTROL},
    "start": {Door.CONTROL},
    "go": {Door.CONTROL},
    "follow": {Door.CONTROL},
    "target": {Door.CONTROL},
    "pause": {Door.CONTROL},
    "arm": {Door.CONTROL},
    "renew": {Door.CONTROL},
    "disarm": {Door.CONTROL, Door.VIEW},
    "stop": {Door.CONTROL, Door.VIEW},
    "disable": {Door.CONTROL},
    "reset": {Door.CONTROL},
    "gain": {Door.CONTROL},
    "guide": {Door.CONTROL},
    "payload": {Door.CONTROL},
    "reload": {Door.CONTROL},
    "status": {Door.CONTROL, Door.VIEW},
    "subscribe": {Door.CONTROL, Door.VIEW},
}


@pytest.mark.parametrize("door", Door)
@pytest.mark.parametrize("command", COMMANDS)
def test_what_a_door_takes(door: Door, command: str) -> None:
    why = refusal(door, command)
    assert command in TAKEN, "say which doors take it"
    assert (why == "") == (door in TAKEN[command])
    if why:
        assert why == "the view socket takes only disarm, status, stop, subscribe"


def test_nothing_that_lets_the_arm_move_is_taken_from_who_looks() -> None:
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
