"""Sentences and tables on standard output. At a terminal, sentences are wrapped between words;
files, pipes and the journal get each in one line."""

import errno
import os
import shutil
import sys
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

import click

UNREAD: Final = 141  # exit status by shell convention after a closed pipe: 128 + SIGPIPE


def say(text: str, *, err: bool = False, dim: bool = False) -> None:
    """Print text, wrapping each line separately and indenting continuations like the line. With
    `err` on stderr."""
    if (sys.stderr if err else sys.stdout).isatty():
        width = shutil.get_terminal_size().columns
        text = "\n".join(folded(line, width) for line in text.splitlines())
    click.echo(click.style(text, dim=True) if dim else text, err=err)


def write_failure(error: OSError) -> str:
    """Reason why output could not be written if the disk is full (`> /dev/full`); empty for other
    errors, and for errors of named files."""
    if error.filename is not None or error.errno not in (errno.ENOSPC, errno.EDQUOT):
        return ""
    return f"cannot write the output: {error.strerror}"


@contextmanager
def read_to_the_end() -> Iterator[None]:
    """Context for output to stdout. If the reader has closed the pipe (`| head -1`), the program
    exits with UNREAD, regardless of the command's result."""
    try:
        try:
            yield
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except BrokenPipeError:
        # The interpreter flushes the rest of the buffer at exit, which must not fail again.
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())
        sys.exit(UNREAD)


def aligned(rows: Sequence[Sequence[str]], *, numbers: bool = False) -> list[str]:
    """Lines of a table; with `numbers` all columns but the first are right-aligned."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    align = [str.ljust, *[str.rjust if numbers else str.ljust] * (len(widths) - 1)]

    def line(row: Sequence[str]) -> str:
        cells = zip(align, row, widths, strict=True)
        return "  ".join(put(cell, width) for put, cell, width in cells).rstrip()

    return [line(row) for row in rows]


def folded(line: str, width: int) -> str:
    """Line wrapped to `width` columns between words, keeping its indentation."""
    indent = line[: len(line) - len(line.lstrip())]
    return textwrap.fill(
        line.lstrip(),
        width,
        initial_indent=indent,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
