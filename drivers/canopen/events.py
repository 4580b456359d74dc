"""Events of the bus beside the samples: typed facts, and as they cross the line to the daemon."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from drivers.api import Event, Kind
from drivers.canopen.emergency_codes import MASTER_SILENT, NO_LONGER, UNKNOWN_CODE, emergency_words


@dataclass(frozen=True, slots=True)
class Fact:
    """Event about the drives of these nodes; without any, about the bus."""

    kind: Kind
    nodes: tuple[int, ...] = ()
    text: str = ""


@dataclass(frozen=True, slots=True)
class Emergency:
    """A drive's EMCY message: error code (0x603F; 0 is "no longer"), error register (0x1001)."""

    node: int
    code: int
    register: int

    @property
    def over(self) -> bool:
        """True for the message that an earlier emergency is over."""
        return self.code == NO_LONGER

    @property
    def kind(self) -> Kind:
        """Error of the drive, or that it missed us."""
        return Kind.UNHEARD if self.code == MASTER_SILENT else Kind.ERROR

    @property
    def nodes(self) -> tuple[int, ...]:
        """Its sender."""
        return (self.node,)

    @property
    def text(self) -> str:
        """Code and register in words."""
        if self.code == UNKNOWN_CODE:
            return "of unknown code, the message is cut short"
        words = emergency_words(self.code)
        code = f"0x{self.code:04X}{words and f' ({words})'}"
        return f"{code}, error register 0x{self.register:02X}"


BusEvent = Fact | Emergency | Event
Report = Callable[[BusEvent | None], None]


def crossing(event: BusEvent, joints: Mapping[int, str]) -> Event | None:
    """Event for the daemon; None for an emergency that is over. joints: names by node."""
    if isinstance(event, Emergency) and event.over:
        return None
    if isinstance(event, Event):
        return event
    return Event(event.kind, described(event, joints))


def described(event: Fact | Emergency, joints: Mapping[int, str]) -> str:
    """Text of an event, with the joint of each drive."""
    drives = ", ".join(
        f"node {node} ({joints[node]})" if node in joints else f"node {node}"
        for node in event.nodes
    )
    return ": ".join(filter(None, (drives, event.text)))
