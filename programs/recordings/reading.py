"""Reader of a recording's contents, up to where its file is intact."""

from pathlib import Path

from programs.clients.log_reader import read_batches
from programs.recordings.contents import Contents


def read_contents(path: Path) -> tuple[Contents, str]:
    """Contents, and why the recording ends early, or empty. Raises LogError if it has no State."""
    contents = Contents()
    return contents, read_batches(path, contents.take)
