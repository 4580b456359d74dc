"""Reasons against arming that samples do not show, in words."""

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
    """Objections to joints whose drives answer no SDO, answer perhaps a period late, send no
    heartbeat, or are not set up; with those of emergencies that are not over."""
    if no_sdo:
        yield Objection(
            "drives",
            f"no answer by SDO from {', '.join(no_sdo)}: a stop by SDO would not reach the drive; "
            "switch it off and on, close tools that use its SDO",
        )
    if doubted:
        names = ", ".join(doubted)
        yield Objection("samples", f"still checking whether {names} answers late: ask again")
    if silent:
        yield Objection("heartbeats", f"no heartbeat received from {', '.join(silent)}")
    yield from emergencies
    if unset:
        yield Objection("set-up", f"not set up: {', '.join(unset)} (`contactctl reset`)")
