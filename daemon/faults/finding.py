"""Findings: conditions that hold in a tick, and the one of several that decides. Pure."""

from dataclasses import dataclass, field

from daemon.faults.conditions import Condition, Response
from daemon.faults.symptoms import advice_of
from daemon.faults.table import TABLE


@dataclass(frozen=True, slots=True)
class Finding:
    """Condition that holds, and its place, such as "LElbowRoll". Figures may change while it stays
    the same finding."""

    condition: Condition
    text: str = ""
    figures: str = field(default="", compare=False)

    @property
    def response(self) -> Response:
        """Response of the table."""
        return TABLE[self.condition].response

    @property
    def check(self) -> str:
        """Name of the arming check that fails with it."""
        return TABLE[self.condition].check

    @property
    def advice(self) -> str:
        """Advice for a person at the arm."""
        return advice_of(self.condition)

    def __str__(self) -> str:
        words = f"{self.condition.value}: {self.text}" if self.text else self.condition.value
        return f"{words} ({self.figures})" if self.figures else words


def advice_on(cause: str) -> str:
    """Advice of the condition with which a cause begins, as `str(Finding)` writes it; empty if it
    begins with none."""
    begins = cause.partition(":")[0].partition(" (")[0]
    return advice_of(Condition(begins)) if begins in set(Condition) else ""


def strongest(findings: tuple[Finding, ...]) -> Finding | None:
    """The finding whose response wins; the first among equals."""
    return max(findings, key=lambda finding: finding.response, default=None)
