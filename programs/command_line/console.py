"""Console for tables of commands: a terminal, or a file or pipe with columns enough for them and no
blanks at the ends of lines, which a terminal behind it would wrap."""

import errno
import os
import re
import sys
from typing import TextIO, cast

from rich.console import Console

FOR_PIPES = 120
_FILLED_UP = re.compile(r" +(?=\n)")


def on_stdout(width: int = FOR_PIPES) -> Console:
    """Console on stdout, where it is no terminal in $COLUMNS or else `width` columns."""
    if sys.stdout.isatty():
        return _StrictConsole()
    asked = os.environ.get("COLUMNS", "")
    width = int(asked) if asked.isdecimal() and int(asked) else width
    return _StrictConsole(width=width, file=cast(TextIO, _Unfilled(sys.stdout)))


class _StrictConsole(Console):
    """Console that raises for a closed pipe: the library's own ends the program with status 1."""

    def on_broken_pipe(self) -> None:
        """Raise BrokenPipeError."""
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))


class _Unfilled:
    """Text stream without the blanks that end lines. A console writes whole lines."""

    def __init__(self, to: TextIO) -> None:
        self._to = to

    def write(self, text: str) -> int:
        """Write it, and return that all of it was."""
        self._to.write(_FILLED_UP.sub("", text))
        return len(text)

    def __getattr__(self, name: str) -> object:
        """Everything else is the stream's."""
        return getattr(self._to, name)
