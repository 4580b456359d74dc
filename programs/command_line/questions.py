"""Questions to a person at a terminal, upon whose answer an arm may move, or learns its signs. What
was typed before a question stood there was meant for something else, and does not answer it."""

import sys
import termios
from collections.abc import Sequence
from contextlib import suppress

import click


def sure(question: str) -> bool:
    """True for a yes; nothing but Enter is a no."""
    _forget_what_was_typed()
    return click.confirm(question)


def choice(question: str, among: Sequence[str]) -> str:
    """One of several answers."""
    _forget_what_was_typed()
    return str(click.prompt(question, type=click.Choice(among)))


def _forget_what_was_typed() -> None:
    with suppress(termios.error, OSError, ValueError):  # a file, a pipe, none: no terminal
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
