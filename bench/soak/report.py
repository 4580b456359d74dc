"""Report of a soak for a terminal: rules, trends, and what happened meanwhile."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from bench.report import Target
from bench.soak.record import Part


def show(part: Part) -> None:
    """Print a part."""
    console = Console(highlight=False)
    console.print(
        f"\n[bold]{part.name}[/]: {part.seconds / 60:.1f} min in {part.took_s / 60:.1f} min"
    )
    rules = Table("rule", "checked", "broken", box=None, padding=(0, 2, 0, 0))
    for rule, count in part.ledger.checked.items():
        broken = part.ledger.broken[rule]
        rules.add_row(rule, f"{count}", f"[red]{broken}[/]" if broken else "0")
    console.print(rules)
    for case in part.ledger.cases:
        console.print(f"[red]broken[/] at {case}", soft_wrap=True, markup=True)
    console.print()
    growths = Table("in the second half", "median", "grows by", "surely", "allowed", box=None)
    for column in growths.columns[1:]:
        column.justify = "right"
    for each in part.trends():
        style = ("red" if each.binding else "yellow") if each.grows else ""
        growths.add_row(
            f"{each.name} [{each.unit}]" if each.unit else each.name,
            f"{each.median:.4g}",
            f"{each.growth:+.3g}",
            f"{each.surely:+.3g}",
            f"{each.allowed:.3g}",
            style=style,
        )
    console.print(growths)
    console.print()
    happened = [f"{what} {part.counts[what]}" for what in sorted(part.counts)]
    console.print(", ".join(happened), style="dim")


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
