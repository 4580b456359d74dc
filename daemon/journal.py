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


class _JournalFormatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return f"<{_PRIORITY.get(record.levelno, 6)}>{super().format(record)}"


@contextmanager
def log_to_stderr() -> Iterator[None]:
    """Everything logged under `contactd` goes to stderr while the block lasts."""
    lines: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    stderr = logging.StreamHandler(sys.stderr)
    if os.environ.get("JOURNAL_STREAM"):
        stderr.setFormatter(_JournalFormatter("%(message)s"))
    else:
        stderr.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
    listener = logging.handlers.QueueListener(lines, stderr)
    handler = logging.handlers.QueueHandler(lines)
    logger = logging.getLogger("contactd")
    logger.setLevel(logging.INFO)
    logger.propagate = False
    logger.addHandler(handler)
    listener.start()
    try:
        yield
    finally:
        listener.stop()
        logger.removeHandler(handler)
