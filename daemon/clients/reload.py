"""Reload: have the daemon read its files anew, and wait until it runs by them."""

from contextlib import suppress
from pathlib import Path

from daemon.clients.client import Client
from daemon.clients.waiting import asked_until
from daemon.protocol.messages import Status
from errors import ControlError, UnreachableError

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
        with suppress(UnreachableError):
            client.packet()  # there is none: the daemon hangs up when it has ended its run
    # It listens all the time, and answers when it has begun anew.
    with Client(path, START_S) as client:
        found = asked_until(client.ask_status, lambda status: bool(status.drives), START_S)
    if found.not_taken_up:
        raise ControlError(f"not taken up: {found.not_taken_up}")
    return found
