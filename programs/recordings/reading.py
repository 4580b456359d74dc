"""Contents of a recording's file, as far as it is whole."""

from pathlib import Path

from daemon.protocol.state import Snapshot, State
from programs.clients.log_reader import read_batches
from programs.recordings.contents import Contents


def read_contents(path: Path) -> tuple[Contents, str]:
    """Contents, and the reason why the recording ends early, empty if it does not. Raises LogError
    where there is no State to read."""
    contents = Contents()

    def take(batch: Snapshot | list[State]) -> None:
        if isinstance(batch, Snapshot):
            contents.add_snapshot(batch)
        else:
            contents.add(batch)

    return contents, read_batches(path, take)
