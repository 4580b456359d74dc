"""Process that gathers rows from the daemon and writes a record for each day.

    python -m programs.trends.writer '{"folder": ..., "arm": ..., "joints": [...], ...}'

It reads rows of float64 from standard input until that ends. Whenever the warnings about the gears
change, it writes a list of them as a line of JSON to standard output.
"""

import logging
import os
import select
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from common.errors import LogError
from daemon.protocol.trend_row import row_length
from daemon.service.journal import log_to_stderr
from programs.trends.day import Day, aside, continued_day, read_day, read_days, today, write_day
from programs.trends.findings import warnings
from programs.trends.gather import Gatherer

WRITES_S: Final = 60.0
_log = logging.getLogger("contactd")


class Job(msgspec.Struct, frozen=True, kw_only=True):
    """Parameters of the process: arm, joints, and folder of the records."""

    folder: str
    arm: str
    joints: list[str]
    period_s: float
    identified: dict[str, str]  # date by joint


class Writer:
    """Writer of one arm's records; time is an argument."""

    def __init__(self, job: Job, report: Callable[[list[str]], None]) -> None:
        self._folder, self._report = Path(job.folder), report
        self._identified = job.identified
        self._width = row_length(len(job.joints))
        self._gatherer = Gatherer(job.arm, job.joints, job.period_s, job.identified)
        self._days: dict[str, Day] = {}
        self._rest, self._reported, self._failed = b"", [""], ""
        self._written_s = -WRITES_S
        self._report_changes()

    def take(self, data: bytes, time_s: float) -> None:
        """Process received bytes, and write the records every WRITES_S."""
        total = len(self._rest) + len(data)
        size = 8 * self._width
        data, cut = self._rest + data, total - total % size
        self._rest = data[cut:]
        rows = np.frombuffer(data[:cut]).reshape(-1, self._width)
        if rows.size:
            self._begin(rows)
            self._gatherer.take(rows, self._days)
        if time_s - self._written_s >= WRITES_S and self._days:
            self.write()
            self._written_s = time_s

    def end(self) -> None:
        """Evaluate and write the rest."""
        self._gatherer.end(self._days)
        if self._days:
            self.write()

    def write(self) -> None:
        """Write all records, and continue with the last one alone."""
        try:
            for day in self._days.values():
                write_day(self._folder, day)
        except LogError as error:
            if str(error) != self._failed:  # logged once, as the disk may be full for days
                _log.warning("trends are not written: %s", error)
            self._failed = str(error)
            return
        self._failed = ""
        last = max(self._days)
        self._days = {last: self._days[last]}
        self._report_changes()

    def _begin(self, rows: np.ndarray) -> None:
        """Continue existing records for the days of these rows."""
        for wall_s in {float(rows[0, 1]), float(rows[-1, 1])}:
            date = time.strftime("%Y-%m-%d", time.gmtime(wall_s))
            path = self._folder / f"{date}.json"
            if date in self._days or not path.exists():
                continue
            try:
                day = read_day(path)
                if day is None:
                    _log.warning("trends: damaged record set aside: %s", aside(path))
                else:
                    self._days[date] = continued_day(day, self._identified)
            except OSError as error:
                _log.warning("trends: %s: %s", path, error.strerror)

    def _report_changes(self) -> None:
        try:
            found = read_days(self._folder, until=today(), set_aside=True)
        except LogError as error:
            _log.warning("trends: %s", error)
            return
        texts = warnings(found.days) + found.words
        if texts != self._reported:
            self._reported = texts
            self._report(texts)


def follow(job: Job, pipe: int, report: Callable[[list[str]], None]) -> None:
    """Gather and write until the pipe ends."""
    writer = Writer(job, report)
    while True:
        # Reads many rows at once, as waking for each would cost more than the work itself.
        time.sleep(0.5)
        select.select([pipe], [], [])
        data = os.read(pipe, 1 << 20)
        if not data:
            break
        writer.take(data, time.monotonic())
    writer.end()


def _print(found: list[str]) -> None:
    try:
        sys.stdout.buffer.write(msgspec.json.encode(found) + b"\n")
        sys.stdout.buffer.flush()
    except OSError:
        pass  # the daemon is gone; the records are still written


if __name__ == "__main__":
    os.nice(10)
    # Ignored, as systemd signals all processes of a service; this one writes when its pipe ends.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    with log_to_stderr():
        follow(msgspec.json.decode(sys.argv[1], type=Job), sys.stdin.fileno(), _print)
