"""Contents of a recording's file, as far as it is whole."""

from pathlib import Path

from common.errors import LogError
from daemon.protocol.state import Snapshot
from programs.clients.replay import batches
from programs.recordings.contents import Contents


def read_contents(path: Path) -> tuple[Contents, str]:
    """Contents, and the reason why the recording ends early, empty if it does not. Raises LogError
    where there is no State to read."""
    contents = Contents()
    try:
        for batch in batches(path):
            if isinstance(batch, Snapshot):
                contents.add_snapshot(batch)
            else:
                contents.add(batch)
    except LogError as error:
        if not contents.states:
            raise
        return contents, str(error)
    if not contents.states:
        raise LogError(f"{path} is a recording without any state")
    return contents, ""
