"""Log lines on stderr, with the priorities that systemd's journal reads; written by a thread that
sleeps until there is one, so that a stuck terminal never holds a tick."""

import logging
import logging.handlers
import os
import queue
import sys
from collections.abc import Iterator
from contextlib import contextmanager

# sd-daemon(3): a line may begin with <priority>.
_PRIORITY = {
    logging.DEBUG: 7,
    logging.INFO: 6,
    logging.WARNING: 4,
    logging.ERROR: 3,
    logging.CRITICAL: 2,
}


# Lines that may wait for the writer; beyond, they are counted instead of kept.
MOST_WAITING = 1000


class _Formatter(logging.Formatter):
    """`[mode tick=812] off -> enabling: ...` for what happened in a tick, else the bare text."""

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
    """Hands lines to the writer, as long as it keeps up."""

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
    """Whether systemd's journal reads stderr (systemd.exec(5), $JOURNAL_STREAM)."""
    about = os.fstat(2)
    return os.environ.get("JOURNAL_STREAM") == f"{about.st_dev}:{about.st_ino}"


@contextmanager
def log_to_stderr() -> Iterator[None]:
    """Everything logged under `contactd` goes to stderr while the block lasts."""
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
