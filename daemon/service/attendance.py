"""Attendance of a motion: the client that began it watches it. When that client is gone, the arm
halts and the motion is forgotten.

Ctrl-C at `contactctl go` sends a stop. A client that is killed, or held up, cannot send one;
therefore the motion ends with its connection, or with its silence, and no later `start` continues
it, as the client that was to end it at a touch no longer watches it.
"""

from dataclasses import dataclass

# A client that watches requests the status some fifty times a second.
SILENT_S = 2.0


@dataclass(slots=True)
class Attendance:
    """Connection that watches the running or paused motion; 0 if it is not attended."""

    silent_s: float = SILENT_S
    _connection: int = 0
    _heard_s: float = 0.0

    @property
    def attended(self) -> bool:
        """True while a client watches the motion."""
        return self._connection != 0

    def begin(self, connection: int, time_s: float) -> None:
        """Set the connection that watches the motion just begun; 0 for none."""
        self._connection, self._heard_s = connection, time_s

    def record_request(self, connection: int, time_s: float) -> None:
        """Record a request of a connection."""
        if connection == self._connection:
            self._heard_s = time_s

    def lost(self, time_s: float, closed: int = 0) -> str:
        """Reason to forget the motion, at `time_s` or because connection number `closed` was
        closed; empty while there is none. Returned once."""
        if not self._connection:
            return ""
        why = ""
        if closed == self._connection:
            why = "its client is gone"
        elif time_s - self._heard_s > self.silent_s:
            why = f"its client has been silent for {self.silent_s:g} s"
        if why:
            self._connection = 0
        return why
