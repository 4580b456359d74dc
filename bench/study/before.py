"""The code before: a commit against which speed and results are held in one run."""

import io
import subprocess
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

#: The last commit before the estimator's compiled kernel.
BEFORE: Final = "4407f2f691ca9c52eb52766db67e761f3ebfb257"
ROOT: Final = Path(__file__).parents[2]


@contextmanager
def code_before(commit: str = BEFORE, repository: Path = ROOT) -> Iterator[Path | None]:
    """A folder with the code of that commit while the block lasts; None where the repository does
    not have it, as a shallow clone or an unpacked archive."""
    archive = _archive(commit, repository)
    if archive is None:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="contactd-before-") as folder:
        with tarfile.open(fileobj=io.BytesIO(archive)) as files:
            files.extractall(folder, filter="data")
        yield Path(folder)


def _archive(commit: str, repository: Path) -> bytes | None:
    """The commit's files as a tar file."""
    try:
        made = subprocess.run(
            ["git", "-C", repository, "archive", "--format=tar", commit],
            capture_output=True,
            check=False,
        )
    except FileNotFoundError:  # no git
        return None
    return made.stdout if made.returncode == 0 else None
