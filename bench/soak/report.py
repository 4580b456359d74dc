"""Report of a soak for a terminal: rules, trends, and what happened meanwhile."""

from collections.abc import Sequence

from bench.report import Target
from bench.soak.record import Part


def targets_of(parts: Sequence[Part]) -> list[Target]:
    """Rules first, then false alarms, then what must not grow."""
    targets = []
    for part in parts:
        at = f"{part.name}: "
        checks, broken = part.ledger.checked.total(), part.ledger.broken.total()
        targets.append(Target(f"{at}rules broken, of {checks} checks", broken, 0))
        hours = part.seconds / 3600.0
        alarms = part.counts["false alarms"] / hours
        targets.append(Target(f"{at}false alarms per hour", alarms, 1.0))
        targets += [
            Target(
                f"{at}growth of {each.name}",
                each.growth if each.grows else min(each.growth, each.allowed),
                each.allowed,
                each.unit,
            )
            for each in part.trends()
        ]
    return targets


def failures(parts: Sequence[Part]) -> list[str]:
    """Reasons for an exit status that is not 0."""
    found = []
    for part in parts:
        found += [f"{part.name}: {rule}, {n} times" for rule, n in part.ledger.broken.items()]
        found += [
            f"{part.name}: {each.name} grows by {each.growth:.4g} {each.unit}"
            for each in part.trends()
            if each.grows and each.binding
        ]
    return found
