"""How much of what happens is told line by line: all, until somebody makes it happen too often.

A bucket of lines that fills up again: a person never sees its bottom, a client that arms and
disarms a hundred times a second does. What is left out then is counted, and told once a second
with every different line among it, so that who did what stays in the log. Pure; time is an
argument.
"""

from dataclasses import dataclass, field

BURST = 30  # lines
PER_S = 2.0
EVERY_S = 1.0
# Different lines that are told of what was left out.
MOST_TOLD = 8


@dataclass(slots=True)
class LogLimit:
    """Of one log."""

    _room: float = BURST
    _time_s: float = 0.0  # when `_room` was true
    _since_s: float = 0.0  # of the first line that was left out
    _left_out: dict[str, int] = field(default_factory=dict)
    _others: int = 0

    def admit(self, line: str, time_s: float) -> bool:
        """Whether to write this line now; otherwise it is kept for `summary`."""
        self._room = min(self._room + PER_S * (time_s - self._time_s), float(BURST))
        self._time_s = time_s
        if self._room >= 1.0 and not self._left_out:
            self._room -= 1.0
            return True
        if not self._left_out:
            self._since_s = time_s
        if line in self._left_out or len(self._left_out) < MOST_TOLD:
            self._left_out[line] = self._left_out.get(line, 0) + 1
        else:
            self._others += 1
        return False

    def summary(self, time_s: float) -> str:
        """What was left out, once it is time to tell; empty until then, and where there is none."""
        if not self._left_out or time_s < self._since_s + EVERY_S:
            return ""
        told = [f"{count} x {line}" for line, count in self._left_out.items()]
        told += [f"{self._others} x others"] * bool(self._others)
        count = sum(self._left_out.values()) + self._others
        self._left_out.clear()
        self._others = 0
        return f"too much to tell line by line, {count} in {EVERY_S:g} s: {'; '.join(told)}"
