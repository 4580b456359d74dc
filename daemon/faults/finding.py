"""Findings: conditions that hold in a tick, and which of several decides. Pure."""

from dataclasses import dataclass, field

from daemon.faults.table import TABLE, Condition, Response


@dataclass(frozen=True, slots=True)
class Finding:
    """A condition that holds, and where: "LElbowRoll". Figures may change while it stays the same
    finding."""

    condition: Condition
    text: str = ""
    figures: str = field(default="", compare=False)

    @property
    def response(self) -> Response:
        """The table's."""
        return TABLE[self.condition].response

    @property
    def check(self) -> str:
        """Name of the arming check that fails with it."""
        return TABLE[self.condition].check

    def __str__(self) -> str:
        words = f"{self.condition.value}: {self.text}" if self.text else self.condition.value
        return f"{words} ({self.figures})" if self.figures else words


def advice_on(cause: str) -> str:
    """Advice on the cause of a mode; empty where that is no finding in words."""
    rows = (row for condition, row in TABLE.items() if cause.startswith(condition))
    return next((row.advice for row in rows), "")


def strongest(findings: tuple[Finding, ...]) -> Finding | None:
    """The finding whose response wins; the first among equals."""
    return max(findings, key=lambda finding: finding.response, default=None)
