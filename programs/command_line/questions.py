"""Questions to a person at a terminal, whose answers may make an arm move, or set its signs. Input
that was typed before a question appeared was meant for something else, and is discarded."""

import sys
import termios
from collections.abc import Sequence
from contextlib import suppress

import click


def confirmed(question: str) -> bool:
    """True if the answer is yes; just Enter means no."""
    _discard_typed()
    return click.confirm(question)


def choice(question: str, among: Sequence[str]) -> str:
    """One of several answers."""
    _discard_typed()
    return str(click.prompt(question, type=click.Choice(among)))


def _discard_typed() -> None:
    with suppress(termios.error, OSError, ValueError):  # stdin is no terminal, or closed
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
