"""Connection to the process that gathers trends: one row per tick to it, warnings from it.

The daemon writes to a pipe and reads from another without blocking: rows that do not fit are left
out, and the process begins a new interval.
"""

import contextlib
import fcntl
import json
import logging
import os
import subprocess
import sys
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from daemon.config.load import Robot
from daemon.modes.table import SENSING
from daemon.protocol.trend_row import (
    DOUBT,
    FRICTION,
    HEAD,
    PER_JOINT,
    RESIDUAL,
    THETA,
    THETA_DOT,
    Q,
    row_length,
)
from daemon.tick.telemetry import TickRecord
from estimator.estimator import Estimator

#: Size of the pipe: some seconds of rows.
PIPE_BYTES: Final = 1 << 20
#: Ticks between two reads of the warnings.
LISTENS_EVERY: Final = 100
_ANSWER_BYTES: Final = 65536
_TIMEOUT_S: Final = 5.0
_log = logging.getLogger("contactd")


class TrendLine:
    """Daemon's end of the connection; `warnings` about the gears, one per line, are the latest."""

    def __init__(self, robot: Robot, folder: Path | None) -> None:
        """Start the process for records in `folder`; without a folder nothing is gathered. If it
        cannot be started the reason is logged, and the arm runs nevertheless."""
        self.warnings: list[str] = []
        self._heard = b""
        self._ticks = 0
        self._process: subprocess.Popen[bytes] | None = None
        n = len(robot.configuration.joints)
        self._row = np.zeros(row_length(n))
        self._joints = self._row[HEAD:].reshape(n, PER_JOINT)
        if folder is None:
            return
        try:
            self._process = _start(robot, folder)
        except OSError as error:
            _log.warning("no trends: %s", error)

    def put(self, record: TickRecord, estimator: Estimator) -> None:
        """Send the row of a tick in which contact is sensed, and read warnings periodically."""
        self._ticks += 1
        if self._process is None:
            return
        if record.estimate is not None and record.mode in SENSING:
            self._send(record, estimator)
        if self._ticks % LISTENS_EVERY == 0 and self._process is not None:  # `_send` may clear it
            self._read_warnings(self._process)

    def _send(self, record: TickRecord, estimator: Estimator) -> None:
        estimate, samples, row = record.estimate, record.samples, self._joints
        assert estimate is not None
        assert self._process is not None
        assert self._process.stdin is not None
        quiet = not estimate.thresholded.any() and record.recognised is None
        self._row[:HEAD] = record.number, record.wakeup.wall_s, quiet
        row[:, Q] = samples.link_position
        row[:, THETA] = np.nan if samples.motor_position is None else samples.motor_position
        row[:, THETA_DOT], row[:, RESIDUAL] = samples.motor_velocity, estimate.residual
        friction = estimator.learned()
        row[:, FRICTION], row[:, DOUBT] = friction.coulomb, friction.coulomb_left
        try:
            os.write(self._process.stdin.fileno(), self._row.tobytes())
        except BlockingIOError:
            return  # a busy machine: this tick is left out
        except OSError as error:
            _log.warning("trends are no longer gathered: %s", error)
            self._process = None

    def _read_warnings(self, process: "subprocess.Popen[bytes]") -> None:
        assert process.stdout is not None
        try:
            heard = os.read(process.stdout.fileno(), _ANSWER_BYTES)
        except BlockingIOError:
            return
        self._heard = (self._heard + heard)[-_ANSWER_BYTES:]
        *lines, self._heard = self._heard.split(b"\n")
        if lines:
            try:
                self.warnings = msgspec.json.decode(lines[-1], type=list[str])
            except msgspec.DecodeError:
                return
            for text in self.warnings:
                _log.warning("%s", text)

    def close(self) -> None:
        """End the process, once it has written its records."""
        if self._process is None or self._process.stdin is None:
            return
        self._process.stdin.close()
        try:
            self._process.wait(_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            _log.warning("the trends of today are still being written")
        if self._process.stdout is not None:
            self._process.stdout.close()


def identified_dates(robot: Robot) -> dict[str, str]:
    """Date of the last identification of each joint's gap or friction, if there was one."""
    if robot.identified is None:
        return {}
    dates = {
        name: max(
            [step.date for step in (joint.gap, joint.friction) if step is not None], default=""
        )
        for name, joint in robot.identified.joints.items()
    }
    return {name: date for name, date in dates.items() if date}


def _start(robot: Robot, folder: Path) -> "subprocess.Popen[bytes]":
    c = robot.configuration
    job = {
        "folder": str(folder),
        "arm": c.name,
        "joints": c.joint_names,
        "period_s": c.period_s,
        "identified": identified_dates(robot),
    }
    # -P: no modules from the working directory. A session of its own: Ctrl-C does not reach it.
    command = [sys.executable, "-P", "-m", "programs.trends.writer", json.dumps(job)]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True, bufsize=0
    )
    assert process.stdin is not None
    assert process.stdout is not None
    for end in (process.stdin, process.stdout):
        os.set_blocking(end.fileno(), False)
    with contextlib.suppress(OSError):  # the kernel's own size holds a second or two
        fcntl.fcntl(process.stdin.fileno(), fcntl.F_SETPIPE_SZ, PIPE_BYTES)
    return process
