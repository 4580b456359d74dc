"""Reload: have the daemon read its files anew, and wait until it runs by them."""

from contextlib import suppress
from pathlib import Path

from common.errors import ControlError, HungUpError
from daemon.protocol.replies import Status
from programs.clients.client import Client
from programs.clients.waiting import asked_until

# As long as a start may take: all drives are set up.
START_S = 60.0


def reload(path: Path | None = None) -> Status:
    """Status of the daemon at this socket once it runs by its files as they are now, off, and hears
    its drives. Every connection to it ends meanwhile.

    Raises ControlError where it is refused, or where the files, or the drives as these say, are not
    taken up, with the reason; UnreachableError if the daemon does not come back.
    """
    with Client(path, START_S) as client:
        client.demand("reload")
        with suppress(HungUpError):
            client.packet()  # there is none: the daemon hangs up when it has ended its run
    found = wait_for_start(path)
    if found.not_taken_up:
        raise ControlError(f"not taken up: {found.not_taken_up}")
    return found


def wait_for_start(path: Path | None = None) -> Status:
    """Status of a daemon that hung up, once it has begun anew and hears its drives: it listens all
    the time, and answers then. Raises UnreachableError if it does not come back."""
    with Client(path, START_S) as client:
        return asked_until(client.ask_status, lambda status: bool(status.drives), START_S)
