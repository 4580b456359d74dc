"""Bus events reported with the samples: typed here, and converted to text for the daemon."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from drivers.api import Event, Kind
from drivers.canopen.emergency_codes import MASTER_SILENT, NO_LONGER, UNKNOWN_CODE, emergency_words


@dataclass(frozen=True, slots=True)
class Fact:
    """Event that concerns the drives of these nodes, or the bus if there are none."""

    kind: Kind
    nodes: tuple[int, ...] = ()
    text: str = ""


@dataclass(frozen=True, slots=True)
class Emergency:
    """EMCY message of a drive: error code (0x603F; 0 is "no error"), error register (0x1001)."""

    node: int
    code: int
    register: int

    @property
    def over(self) -> bool:
        """True if the message ends an earlier emergency."""
        return self.code == NO_LONGER

    @property
    def kind(self) -> Kind:
        """Kind of event: missed heartbeat of the master, or another error."""
        return Kind.UNHEARD if self.code == MASTER_SILENT else Kind.ERROR

    @property
    def nodes(self) -> tuple[int, ...]:
        """Node that sent it."""
        return (self.node,)

    @property
    def text(self) -> str:
        """Error code and register as text."""
        if self.code == UNKNOWN_CODE:
            return "unknown code, the message is truncated"
        words = emergency_words(self.code)
        code = f"0x{self.code:04X}{words and f' ({words})'}"
        return f"{code}, error register 0x{self.register:02X}"


BusEvent = Fact | Emergency | Event
Report = Callable[[BusEvent | None], None]


def crossing(event: BusEvent, joints: Mapping[int, str]) -> Event | None:
    """Event for the daemon; None for the end of an emergency. joints: names by node."""
    if isinstance(event, Emergency) and event.over:
        return None
    if isinstance(event, Event):
        return event
    return Event(event.kind, described(event, joints))


def described(event: Fact | Emergency, joints: Mapping[int, str]) -> str:
    """Text of an event, with the node and joint of each drive."""
    drives = ", ".join(
        f"node {node} ({joints[node]})" if node in joints else f"node {node}"
        for node in event.nodes
    )
    return ": ".join(filter(None, (drives, event.text)))
