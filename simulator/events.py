"""Events of the simulation that a bystander would notice."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class SimulationEvent:
    """One event, such as the fault of a drive or a push of the hand; `text` is one sentence."""

    at_s: float
    """Simulated time [s]."""
    kind: Literal["drive", "hand", "server"]
    text: str


Listener = Callable[[SimulationEvent], None]
