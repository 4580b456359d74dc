"""Event log: lines on stderr with priorities for systemd's journal, and a limit on their rate.

A thread that sleeps until there is a line writes it, so that a stuck terminal never holds a tick.

All events are logged line by line, until a client causes too many: the limit is a token bucket. A
person never exhausts it; a client that arms and disarms a hundred times a second does. Lines left
out then are counted, and summarised once a second with every different line among them, so that the
log still shows which client did what.
"""

import logging
import logging.handlers
import os
import queue
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

# sd-daemon(3): a line may begin with <priority>.
_PRIORITY = {
    logging.DEBUG: 7,
    logging.INFO: 6,
    logging.WARNING: 4,
    logging.ERROR: 3,
    logging.CRITICAL: 2,
}


# Lines that may wait for the writer; further lines are only counted.
MOST_WAITING = 1000
# The rate limit: a bucket of lines, and how fast it fills up again.
BURST = 30  # lines
PER_S = 2.0
SUMMARY_EVERY_S = 1.0
# Different lines that a summary of lines left out contains.
MOST_NAMED = 8


class _Formatter(logging.Formatter):
    """Lines like `[mode tick=812] off -> enabling: ...` for notices of a tick, else the text
    alone."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        kind = getattr(record, "kind", "")
        if kind:
            record.message = f"[{kind} tick={record.__dict__['tick']}] {record.message}"
        return super().formatMessage(record)


class _JournalFormatter(_Formatter):
    def format(self, record: logging.LogRecord) -> str:
        priority = _PRIORITY.get(record.levelno, 6)
        # A traceback has many lines, and each is an entry of its own.
        return "\n".join(f"<{priority}>{line}" for line in super().format(record).splitlines())


class _BoundedHandler(logging.handlers.QueueHandler):
    """Queue of lines for the writer; lines beyond MOST_WAITING are dropped and counted."""

    queue: queue.SimpleQueue[logging.LogRecord]
    lost = 0

    def enqueue(self, record: logging.LogRecord) -> None:
        if self.queue.qsize() >= MOST_WAITING:
            self.lost += 1
            return
        if self.lost:
            record.msg = f"{record.msg} ({self.lost} lines before this one were lost)"
            self.lost = 0
        self.queue.put_nowait(record)


def stderr_is_journal() -> bool:
    """True if systemd's journal reads stderr (systemd.exec(5), $JOURNAL_STREAM)."""
    about = os.fstat(2)
    return os.environ.get("JOURNAL_STREAM") == f"{about.st_dev}:{about.st_ino}"


@contextmanager
def log_to_stderr() -> Iterator[None]:
    """Write everything logged under `contactd` to stderr while the block lasts."""
    lines: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    stderr = logging.StreamHandler(sys.stderr)
    if stderr_is_journal():
        stderr.setFormatter(_JournalFormatter("%(message)s"))
    else:
        stderr.setFormatter(_Formatter("%(asctime)s %(levelname)-7s %(message)s"))
    listener = logging.handlers.QueueListener(lines, stderr)
    handler = _BoundedHandler(lines)
    logger = logging.getLogger("contactd")
    before = logger.level, logger.propagate
    logger.setLevel(logging.INFO)
    logger.propagate = False
    logger.addHandler(handler)
    listener.start()
    try:
        yield
    finally:
        listener.stop()
        logger.removeHandler(handler)
        logger.setLevel(before[0])
        logger.propagate = before[1]


@dataclass(slots=True)
class LogLimit:
    """Rate limit for one event log."""

    _room: float = BURST
    _time_s: float = 0.0  # time of `_room`
    _since_s: float = 0.0  # of the first line that was left out
    _left_out: dict[str, int] = field(default_factory=dict)
    _others: int = 0

    def admit(self, line: str, time_s: float) -> bool:
        """True if this line may be written now; otherwise it is kept for `summary`."""
        self._room = min(self._room + PER_S * (time_s - self._time_s), float(BURST))
        self._time_s = time_s
        if self._room >= 1.0 and not self._left_out:
            self._room -= 1.0
            return True
        if not self._left_out:
            self._since_s = time_s
        if line in self._left_out or len(self._left_out) < MOST_NAMED:
            self._left_out[line] = self._left_out.get(line, 0) + 1
        else:
            self._others += 1
        return False

    def summary(self, time_s: float) -> str:
        """Summary of the lines left out, once it is due; empty until then, and without any."""
        if not self._left_out or time_s < self._since_s + SUMMARY_EVERY_S:
            return ""
        lines = [f"{count} x {line}" for line, count in self._left_out.items()]
        lines += [f"{self._others} x others"] * bool(self._others)
        count = sum(self._left_out.values()) + self._others
        self._left_out.clear()
        self._others = 0
        return f"too many lines, {count} in {SUMMARY_EVERY_S:g} s: {'; '.join(lines)}"
