"""Log lines as the journal gets them, and a writer that is stuck."""

import logging
import os
import subprocess
import sys

import pytest

from daemon.service import journal

SAY = """
import logging, os
about = os.fstat(2)
if {connected}:
    os.environ["JOURNAL_STREAM"] = f"{{about.st_dev}}:{{about.st_ino}}"
from daemon.service.journal import log_to_stderr
with log_to_stderr():
    log = logging.getLogger("contactd")
    log.info("%s", "off -> enabling: enable", extra={{"kind": "mode", "tick": 812}})
    log.error("%s", "samples stale", extra={{"kind": "fault", "tick": 813}})
    log.warning("real time: memory not locked")
"""


def said(*, connected: bool) -> list[str]:
    environment = {**os.environ, "JOURNAL_STREAM": "1:2"}  # of some other stream
    program = [sys.executable, "-c", SAY.format(connected=connected)]
    done = subprocess.run(program, stderr=subprocess.PIPE, text=True, env=environment, check=True)
    return done.stderr.splitlines()


def test_the_journal_gets_a_priority_and_what_happened_in_which_tick() -> None:
    assert said(connected=True) == [
        "<6>[mode tick=812] off -> enabling: enable",
        "<3>[fault tick=813] samples stale",
        "<4>real time: memory not locked",
    ]


def test_a_terminal_gets_the_time_and_no_priorities() -> None:
    lines = said(connected=False)
    assert [line.split(maxsplit=2)[2] for line in lines] == [
        "INFO    [mode tick=812] off -> enabling: enable",
        "ERROR   [fault tick=813] samples stale",
        "WARNING real time: memory not locked",
    ]


def test_lines_for_a_stuck_writer_are_counted_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal, "MOST_WAITING", 3)
    lines = journal.queue.SimpleQueue[logging.LogRecord]()
    handler = journal._BoundedHandler(lines)
    for k in range(10):
        handler.handle(logging.makeLogRecord({"msg": f"line {k}"}))
    assert lines.qsize() == 3
    while not lines.empty():
        lines.get()
    handler.handle(logging.makeLogRecord({"msg": "line 10"}))
    handler.handle(logging.makeLogRecord({"msg": "line 11"}))
    kept = [lines.get().getMessage() for _ in range(lines.qsize())]
    assert kept == ["line 10 (7 lines before this one were lost)", "line 11"]


def test_the_logger_is_left_as_it_was() -> None:
    logger = logging.getLogger("contactd")
    before = logger.level, logger.propagate, list(logger.handlers)
    with journal.log_to_stderr():
        assert not logger.propagate
    assert (logger.level, logger.propagate, logger.handlers) == before
