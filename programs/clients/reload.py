"""Reload of the daemon's files, with a wait until it runs again."""

from contextlib import suppress
from pathlib import Path

from common.errors import ClosedError, ControlError
from daemon.protocol.replies import Status
from programs.clients.client import Client
from programs.clients.waiting import asked_until

# Timeout of a start, in which all drives are set up.
START_S = 60.0


def reload(path: Path | None = None) -> Status:
    """Make the daemon at this socket reload its files; returns its Status once it runs with them,
    in mode off, and receives from its drives. All connections to it end meanwhile.

    Raises ControlError with the reason if this is refused, or if the files are invalid or the
    drives cannot be set up with them; UnreachableError if the daemon does not come back.
    """
    with Client(path, START_S) as client:
        client.demand("reload")
        with suppress(ClosedError):
            client.packet()  # none comes: the daemon hangs up once it has ended its run
    found = wait_for_start(path)
    if found.not_taken_up:
        raise ControlError(f"not taken up: {found.not_taken_up}")
    return found


def wait_for_start(path: Path | None = None) -> Status:
    """Status of a daemon that hung up, once it has restarted and receives from its drives; it
    accepts connections meanwhile. Raises UnreachableError if it does not come back."""
    with Client(path, START_S) as client:
        return asked_until(client.ask_status, lambda status: bool(status.drives), START_S)
