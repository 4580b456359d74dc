"""Progress bars on stderr; none if stderr is not a terminal."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def reading(file: Path, *, shown: bool = True) -> Iterator[Callable[[float], None]]:
    """Context that shows the share of `file` that was read, as reported by the block."""
    if not (shown and sys.stderr.isatty()):
        yield lambda share: None
        return
    from rich.console import Console  # noqa: PLC0415 - only at a terminal
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(file.name, total=1.0)
        yield lambda share: bar.update(task, completed=share)


@contextmanager
def counting(total: int, *, shown: bool = True) -> Iterator[Callable[[], None]]:
    """Context that shows how many of `total` recordings are done, as reported by the block."""
    if not (shown and sys.stderr.isatty() and total > 1):
        yield lambda: None
        return
    from rich.console import Console  # noqa: PLC0415 - only at a terminal
    from rich.progress import BarColumn, MofNCompleteColumn, Progress  # noqa: PLC0415

    with Progress(
        BarColumn(), MofNCompleteColumn(), console=Console(stderr=True), transient=True
    ) as bar:
        task = bar.add_task("", total=total)
        yield lambda: bar.advance(task)
