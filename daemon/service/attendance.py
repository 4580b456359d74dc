"""Attendance of a way: the client that asked for it watches it, and the arm halts when it is gone.

Somebody who waits at `contactctl go` takes Ctrl-C for their stop. Killed, or held up, that client
stops nothing any more; so the way ends with its connection, or with its silence.
"""

from dataclasses import dataclass

# A client that watches asks for the status some fifty times a second.
SILENT_S = 2.0


@dataclass(slots=True)
class Attendance:
    """Connection that watches the way which runs now; 0 where none needs to be watched."""

    silent_s: float = SILENT_S
    _connection: int = 0
    _heard_s: float = 0.0

    def begin(self, connection: int, time_s: float) -> None:
        """The way that has begun is watched by a connection; 0: by none."""
        self._connection, self._heard_s = connection, time_s

    def heard(self, connection: int, time_s: float) -> None:
        """A request came."""
        if connection == self._connection:
            self._heard_s = time_s

    def lost(self, time_s: float, closed: int = 0) -> str:
        """Reason to halt, at `time_s` or because connection number `closed` was closed; empty while
        there is none. Said once."""
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
