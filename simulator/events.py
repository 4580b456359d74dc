"""Events of the simulation that a person beside the arm would notice."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class Happening:
    """One event: a drive that faults, a hand that pushes; `text` is one sentence for people."""

    at_s: float
    """simulated time [s]"""
    kind: Literal["drive", "hand", "server"]
    text: str


Listener = Callable[[Happening], None]
