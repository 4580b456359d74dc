"""Sentences and tables for a person: at a terminal a sentence goes on in the next line between two
words, where the terminal alone would cut one in two. Files, pipes and the journal get it in one
line."""

import errno
import os
import shutil
import sys
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

import click

UNREAD: Final = 141  # as shells report it of a program that a closed pipe ended


def say(text: str, *, err: bool = False, dim: bool = False) -> None:
    """Print one sentence or more, each line of `text` for itself; what a line is indented by, its
    continuation is, too. With `err` on stderr."""
    if (sys.stderr if err else sys.stdout).isatty():
        width = shutil.get_terminal_size().columns
        text = "\n".join(folded(line, width) for line in text.splitlines())
    click.echo(click.style(text, dim=True) if dim else text, err=err)


def could_not_say(error: OSError) -> str:
    """Reason why an answer could not be written if the disk is full (`> /dev/full`); empty for
    other errors, and for those of named files."""
    if error.filename is not None or error.errno not in (errno.ENOSPC, errno.EDQUOT):
        return ""
    return f"the answer cannot be written: {error.strerror}"


@contextmanager
def read_to_the_end() -> Iterator[None]:
    """Block whose answer goes to stdout. Once its reader has closed the pipe (`| head -1`) the
    program ends with a status of its own, independent of the command's result."""
    try:
        try:
            yield
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except BrokenPipeError:
        # What is left in the buffer is flushed once more at exit, and must go somewhere.
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())
        sys.exit(UNREAD)


def aligned(rows: Sequence[Sequence[str]], *, numbers: bool = False) -> list[str]:
    """Lines of a table; of `numbers` all columns but the first are aligned at their right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    align = [str.ljust, *[str.rjust if numbers else str.ljust] * (len(widths) - 1)]

    def line(row: Sequence[str]) -> str:
        cells = zip(align, row, widths, strict=True)
        return "  ".join(put(cell, width) for put, cell, width in cells).rstrip()

    return [line(row) for row in rows]


def folded(line: str, width: int) -> str:
    """Line in as many of `width` columns as its words take."""
    indent = line[: len(line) - len(line.lstrip())]
    return textwrap.fill(
        line.lstrip(),
        width,
        initial_indent=indent,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
