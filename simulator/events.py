"""What an onlooker would notice: a drive that faults, a hand that pushes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class Happening:
    """`at_s` in simulated time; `text` is one sentence for people."""

    at_s: float
    kind: Literal["drive", "hand", "server"]
    text: str


Listener = Callable[[Happening], None]
