"""Arms of a fleet as a supervisor sees them: which are alive, and their last messages. Pure.

Its input, liveliness tokens and `/diagnostics`, may come from anywhere: it is only used as text to
show, and at most MOST_ARMS are kept.
"""

from dataclasses import dataclass, replace
from typing import Final

from daemon.protocol.text import printable
from programs.zenoh.messages import Diagnosis, Level
from programs.zenoh.names import ADMIN, NAME, Kind

MOST_ARMS: Final = 256
MOST_OF_ONE_NAME: Final = 16
MOST_NAME: Final = 255  # characters, as for topics in ROS 2
MOST_TEXT: Final = 200
#: Somewhat more than twice the period of an arm's messages.
SILENT_S: Final = 2.5
NODE_NAME: Final = "contactd"


@dataclass(frozen=True, slots=True)
class Arm:
    """One arm; times by the supervisor's monotonic clock."""

    name: str  # namespace without the leading slash
    nodes: frozenset[str] = frozenset()  # present tokens of this name, normally one
    heard_s: float | None = None
    level: Level = Level.STALE
    text: str = ""
    mode: str = ""
    armed: str = ""
    contact: str = ""  # last one received

    @property
    def alive(self) -> bool:
        """True if a node of this name is present."""
        return bool(self.nodes)

    @property
    def says(self) -> str:
        """Last message, or a hint if there is none although the arm is alive."""
        unheard = self.alive and self.heard_s is None
        return "no message yet; does it use another --distro?" if unheard else self.text

    def silent_s(self, now_s: float) -> float | None:
        """Time since its last message [s]; None if it is not silent."""
        if self.heard_s is None:
            return None
        silence = now_s - self.heard_s
        return silence if silence > SILENT_S or not self.alive else None

    def state(self, now_s: float) -> str:
        """State in words: alive, gone or silent."""
        silent_s = self.silent_s(now_s)
        if silent_s is not None:
            return f"silent for {silent_s:.0f} s"
        if len(self.nodes) > 1:
            return f"alive, {len(self.nodes)} of this name"
        return "alive" if self.alive else "gone"


def arm_of_token(token: str, domain: int) -> str:
    """Name of the arm whose node has this token; empty if it is no node of contactd."""
    parts = token.split("/")
    if len(parts) != 9 or parts[:2] != [ADMIN, str(domain)]:
        return ""
    namespace = parts[7].replace("%", "/")
    if parts[5] != Kind.NODE or parts[8] != NODE_NAME or not _is_namespace(namespace):
        return ""
    return namespace[1:]


class Fleet:
    """Arms seen so far, by name; those that are gone are kept while there is room."""

    def __init__(self) -> None:
        self.arms: dict[str, Arm] = {}

    def meet(self, name: str, alive: bool, token: str) -> None:
        """Add or remove a token of an arm."""
        arm = self._arm(name)
        nodes = arm.nodes | {token} if alive else arm.nodes - {token}
        if len(nodes) <= MOST_OF_ONE_NAME:
            self._put(replace(arm, nodes=nodes))

    def on_diagnostics(self, diagnoses: list[Diagnosis], now_s: float) -> None:
        """Take a message on `/diagnostics`; those of other programs are ignored."""
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
        """Take a message on an arm's topic `contact`."""
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
        """Forget the arm that is gone and silent for longest, if any. Arms that are alive are kept,
        as they can be stopped."""
        gone = [arm for arm in self.arms.values() if not arm.alive]
        if gone:
            del self.arms[min(gone, key=lambda arm: arm.heard_s or 0.0).name]


def _is_namespace(text: str) -> bool:
    return len(text) <= 1 + MOST_NAME and NAME.fullmatch(text) is not None


def shown(text: str) -> str:
    """Text from the network, shortened and made safe for a terminal."""
    return printable(text[:MOST_TEXT])
