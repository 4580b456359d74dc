"""Console for the tables of commands: on a terminal, or on a file or pipe, with a fixed width and
without trailing blanks, which a terminal behind a pipe would wrap."""

import errno
import os
import re
import sys
from typing import TextIO, cast

from rich.console import Console

FOR_PIPES = 120
_FILLED_UP = re.compile(r" +(?=\n)")


def on_stdout(width: int = FOR_PIPES) -> Console:
    """Console on stdout; unless that is a terminal, of $COLUMNS or else `width` columns."""
    if sys.stdout.isatty():
        return _StrictConsole()
    asked = os.environ.get("COLUMNS", "")
    width = int(asked) if asked.isdecimal() and int(asked) else width
    return _StrictConsole(width=width, file=cast(TextIO, _Unfilled(sys.stdout)))


class _StrictConsole(Console):
    """Console that raises for a closed pipe, where the library would exit with status 1."""

    def on_broken_pipe(self) -> None:
        """Raise BrokenPipeError."""
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))


class _Unfilled:
    """Text stream that removes trailing blanks. A console writes complete lines."""

    def __init__(self, to: TextIO) -> None:
        self._to = to

    def write(self, text: str) -> int:
        """Write a text, and return its length."""
        self._to.write(_FILLED_UP.sub("", text))
        return len(text)

    def __getattr__(self, name: str) -> object:
        """Attribute of the underlying stream."""
        return getattr(self._to, name)
