"""Findings: conditions that hold in a tick, and the strongest of several. Pure."""

from dataclasses import dataclass, field

from daemon.faults.conditions import Condition, Response
from daemon.faults.symptoms import advice_of
from daemon.faults.table import TABLE


@dataclass(frozen=True, slots=True)
class Finding:
    """Condition that holds, and its place, such as "LElbowRoll". Findings that differ only in their
    figures are equal."""

    condition: Condition
    text: str = ""
    figures: str = field(default="", compare=False)

    @property
    def response(self) -> Response:
        """Response by the table of faults."""
        return TABLE[self.condition].response

    @property
    def check(self) -> str:
        """Name of the arming check that fails."""
        return TABLE[self.condition].check

    @property
    def advice(self) -> str:
        """Advice for a person at the arm."""
        return advice_of(self.condition)

    def __str__(self) -> str:
        words = f"{self.condition.value}: {self.text}" if self.text else self.condition.value
        return f"{words} ({self.figures})" if self.figures else words


def advice_on(cause: str) -> str:
    """Advice for a cause that begins with a condition, as `str(Finding)` writes it; empty for any
    other cause."""
    begins = cause.partition(":")[0].partition(" (")[0]
    return advice_of(Condition(begins)) if begins in set(Condition) else ""


def strongest(findings: tuple[Finding, ...]) -> Finding | None:
    """Finding with the strongest response, the first of equals; None if there are none."""
    return max(findings, key=lambda finding: finding.response, default=None)
