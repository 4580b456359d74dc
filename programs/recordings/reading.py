"""Contents of a recording's file, as far as it is whole."""

from pathlib import Path

from programs.clients.log_reader import read_batches
from programs.recordings.contents import Contents


def read_contents(path: Path) -> tuple[Contents, str]:
    """Contents, and the reason why the recording ends early, empty if it does not. Raises LogError
    where there is no State to read."""
    contents = Contents()
    return contents, read_batches(path, contents.take)
