"""Active emergencies of the drives, tracked across ticks."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

from drivers.api import DriveStatus, Kind, Objection
from drivers.canopen.events import BusEvent, Emergency, Fact, described


class Emergencies:
    """Last active emergency of each drive of one arm."""

    def __init__(self, joints: Mapping[int, str]) -> None:
        """joints: names by node, in the order of the arm."""
        self._joints, self._index = joints, {node: i for i, node in enumerate(joints)}
        self._open: dict[int, Emergency] = {}  # by node
        self._in_fault: set[int] = set()

    def watch(self, events: Sequence[BusEvent], drives: Sequence[DriveStatus]) -> None:
        """Record the emergencies that began or ended in one tick."""
        for event in events:
            if isinstance(event, Emergency) and not event.over:
                self._open[event.node] = event
            elif isinstance(event, Emergency) or (
                isinstance(event, Fact) and event.kind is Kind.RESTARTED
            ):
                for node in event.nodes:
                    self._over(node)
        # Leaving the fault state ends an emergency, whether or not the drive reports its end.
        for node in tuple(self._open):
            if node in self._index and drives[self._index[node]].condition.in_fault:
                self._in_fault.add(node)
            elif node in self._in_fault:
                self._over(node)

    def renewed(self, joints: Iterable[int] | None) -> None:
        """Clear emergencies of drives that were set up again (None: all): as no tick ran meanwhile,
        their end was not received."""
        chosen = None if joints is None else set(joints)
        for node, joint in self._index.items():
            if chosen is None or joint in chosen:
                self._over(node)

    def acknowledge(self) -> None:
        """Clear emergencies of drives that are not in fault, on the operator's reset: some drives
        never report the end of an emergency."""
        for node in tuple(self._open):
            if node not in self._in_fault:
                self._over(node)

    def _over(self, node: int) -> None:
        self._open.pop(node, None)
        self._in_fault.discard(node)

    def objections(self) -> Iterator[Objection]:
        """Active emergencies, as reasons against arming."""
        for emergency in self._open.values():
            text = f"emergency of {described(emergency, self._joints)}, still active"
            unheard = emergency.kind is Kind.UNHEARD
            yield Objection("heartbeats" if unheard else "emergencies", text)
