"""Reasons against arming that are not visible in the samples, as text."""

from collections.abc import Iterable, Iterator, Sequence

from drivers.api import Objection


def objections_of(
    *,
    no_sdo: Sequence[str],
    doubted: Sequence[str],
    silent: Sequence[str],
    emergencies: Iterable[Objection],
    unset: Sequence[str],
) -> Iterator[Objection]:
    """Objections for joints whose drives do not answer SDO, may answer a period late, send no
    heartbeat, or are not set up; and those for active emergencies."""
    if no_sdo:
        yield Objection(
            "drives",
            f"no SDO answer from {', '.join(no_sdo)}: a stop by SDO would not reach the drive; "
            "power-cycle it, and close tools that use its SDO",
        )
    if doubted:
        names = ", ".join(doubted)
        yield Objection("samples", f"still checking whether {names} answers late: ask again")
    if silent:
        yield Objection("heartbeats", f"no heartbeat received from {', '.join(silent)}")
    yield from emergencies
    if unset:
        yield Objection("set-up", f"not set up: {', '.join(unset)} (`contactctl reset`)")
