"""Arms of a fleet as one supervisor sees them: which are alive, and their last messages. Pure.

Fed by liveliness tokens and `/diagnostics`, from wherever: nothing in them is believed but as text
to show, and no more than MOST_ARMS are kept.
"""

from dataclasses import dataclass, replace
from typing import Final

from daemon.protocol.text import printable
from programs.zenoh.messages import Diagnosis, Level
from programs.zenoh.names import ADMIN, NAME, Kind

MOST_ARMS: Final = 256
MOST_OF_ONE_NAME: Final = 16
MOST_NAME: Final = 255  # characters, as of any topic in ROS 2
MOST_TEXT: Final = 200
#: Twice the time between two messages of an arm, and some more.
SILENT_S: Final = 2.5
NODE_NAME: Final = "contactd"


@dataclass(frozen=True, slots=True)
class Arm:
    """One arm; times by the supervisor's monotonic clock."""

    name: str  # its namespace, without the first slash
    nodes: frozenset[str] = frozenset()  # tokens of this name that are there: one, if all is well
    heard_s: float | None = None
    level: Level = Level.STALE
    text: str = ""
    mode: str = ""
    armed: str = ""
    contact: str = ""  # the last one that was heard of

    @property
    def alive(self) -> bool:
        """Whether a node of this name is there."""
        return bool(self.nodes)

    @property
    def says(self) -> str:
        """Its last message."""
        unheard = self.alive and self.heard_s is None
        return "nothing heard of it yet; is it of another --distro?" if unheard else self.text

    def silent_s(self, now_s: float) -> float | None:
        """Time since it was last heard [s]; None while it is heard."""
        if self.heard_s is None:
            return None
        silence = now_s - self.heard_s
        return silence if silence > SILENT_S or not self.alive else None

    def state(self, now_s: float) -> str:
        """Whether it is there, in words."""
        silent_s = self.silent_s(now_s)
        if silent_s is not None:
            return f"silent since {silent_s:.0f} s"
        if len(self.nodes) > 1:
            return f"alive, {len(self.nodes)} of this name"
        return "alive" if self.alive else "gone"


def arm_of_token(token: str, domain: int) -> str:
    """Name of the arm whose node has this token; empty where it is no node of contactd."""
    parts = token.split("/")
    if len(parts) != 9 or parts[:2] != [ADMIN, str(domain)]:
        return ""
    namespace = parts[7].replace("%", "/")
    if parts[5] != Kind.NODE or parts[8] != NODE_NAME or not _is_namespace(namespace):
        return ""
    return namespace[1:]


class Fleet:
    """Arms that were seen, by name; of those that are gone as many as there is room for."""

    def __init__(self) -> None:
        self.arms: dict[str, Arm] = {}

    def meet(self, name: str, alive: bool, token: str) -> None:
        """A token came, or went."""
        arm = self._arm(name)
        nodes = arm.nodes | {token} if alive else arm.nodes - {token}
        if len(nodes) <= MOST_OF_ONE_NAME:
            self._put(replace(arm, nodes=nodes))

    def hear(self, diagnoses: list[Diagnosis], now_s: float) -> None:
        """A message on `/diagnostics`; those of other programs are left out."""
        for found in diagnoses:
            prefix, _, name = found.name.partition(": ")
            if prefix != "contactd" or ":" in name or not _is_namespace(f"/{name}"):
                continue
            values = dict(found.values)
            self._put(
                replace(
                    self._arm(name),
                    heard_s=now_s,
                    level=found.level,
                    text=shown(found.message),
                    mode=shown(values.get("mode", "")),
                    armed=shown(values.get("armed", "")),
                )
            )

    def touch(self, contact: Diagnosis) -> None:
        """A message on an arm's `contact`."""
        if _is_namespace(f"/{contact.hardware_id}"):
            self._put(replace(self._arm(contact.hardware_id), contact=shown(contact.message)))

    def _arm(self, name: str) -> Arm:
        return self.arms.get(name, Arm(name))

    def _put(self, arm: Arm) -> None:
        if arm.alive and arm.name not in self.arms and len(self.arms) >= MOST_ARMS:
            self._make_room()
        if arm.name in self.arms or len(self.arms) < MOST_ARMS:
            self.arms[arm.name] = arm

    def _make_room(self) -> None:
        """Forget the one of those that are gone that was not heard of for longest, if there is one:
        an arm that is alive can be stopped, so it comes first."""
        gone = [arm for arm in self.arms.values() if not arm.alive]
        if gone:
            del self.arms[min(gone, key=lambda arm: arm.heard_s or 0.0).name]


def _is_namespace(text: str) -> bool:
    return len(text) <= 1 + MOST_NAME and NAME.fullmatch(text) is not None


def shown(text: str) -> str:
    """Text from a network as it may stand on a terminal."""
    return printable(text[:MOST_TEXT])
