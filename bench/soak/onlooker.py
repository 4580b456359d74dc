"""Times at which a hand is on the simulated arm, from the events of `contactd simulate`."""

import json
from pathlib import Path


class Onlooker:
    """Reads the simulator's events while they are written."""

    def __init__(self, events: Path) -> None:
        self._stream = events.open()
        self._since_s: float | None = None
        self._rest = ""
        self._touches: list[tuple[float, float]] = []

    def close(self) -> None:
        """No more of it."""
        self._stream.close()

    def look(self) -> bool:
        """Take what is new; whether a hand is on the arm now."""
        *lines, self._rest = (self._rest + self._stream.read()).split("\n")
        for line in lines:
            event = json.loads(line)
            if event["kind"] == "hand":
                self._take(event["text"], event["monotonic_s"])
        return self._since_s is not None

    def _take(self, text: str, time_s: float) -> None:
        if text.startswith(("begin push", "begin guide", "begin hold")):
            self._since_s = time_s
        elif text.startswith(("end push", "begin release")) and self._since_s is not None:
            self._touches.append((self._since_s, time_s))
            self._since_s = None

    @property
    def touches(self) -> list[tuple[float, float]]:
        """Beginning and end of each touch [s, CLOCK_MONOTONIC]; the last may still go on."""
        lasting = [] if self._since_s is None else [(self._since_s, float("inf"))]
        return self._touches + lasting
