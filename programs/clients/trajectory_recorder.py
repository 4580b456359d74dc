"""Recorder of trajectories: joint positions as a CSV file that `contactctl start` runs.

An arm is taught by leading it. Motor positions at the link side are recorded, as no motor could
repeat the motion of a link that falls from one side of its gap to the other.
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from common.errors import UnreachableError
from common.new_file import open_new, refuse_unless_new
from daemon.motion.trajectory_file import MAX_ROWS, TIME
from daemon.protocol.state import State
from programs.clients.client import Client
from programs.clients.truncated import holds_a_row, truncated

# Averaging time of a sample [s]: short for a hand's motion, but long enough that the encoder's
# resolution does not appear as acceleration.
SAMPLE_S = 0.05


@dataclass(frozen=True, slots=True)
class Recorded:
    """Result of `record_trajectory`."""

    path: str
    duration_s: float
    samples: int
    ended: str  # why it ended early, or empty

    def __str__(self) -> str:
        return f"{self.duration_s:.1f} s, {self.samples} samples"


def record_trajectory(
    connect: Callable[[], Client],
    path: Path,
    *,
    seconds: float | None = None,
    stop: Callable[[], bool] = lambda: False,
    until: Callable[[State], bool] = lambda _: False,
    begun: Callable[[], None] = lambda: None,
) -> Recorded:
    """Write the motor positions of all joints, at the link [rad], to a new CSV file until `stop()`
    or `until(state)` is true, for `seconds`, up to the maximum length of a trajectory, or until the
    daemon ends. `begun` is called once the recording has begun.

    Raises LogError if `path` exists or cannot be written (it then keeps complete rows, or is
    removed), ControlError if there is no daemon at the start.
    """
    refuse_unless_new(path)
    ended, samples, first_s, last_s = "", 0, 0.0, 0.0
    with connect() as client:
        snapshot, states = client.subscribe()
        stream = open_new(path, "x", newline="", encoding="utf-8")
        try:
            with stream:
                writer = csv.writer(stream, lineterminator="\n")
                writer.writerow([TIME, *snapshot.joints])
                begun()
                window: list[State] = []
                for state in states:
                    window.append(state)
                    if state.time_s - window[0].time_s < SAMPLE_S - 0.5 * snapshot.period_s:
                        continue
                    middle_s = _mean([s.time_s for s in window])
                    first_s = first_s if samples else middle_s
                    last_s = middle_s
                    columns = zip(*(s.motor_estimate for s in window), strict=True)
                    row = [last_s - first_s, *(_mean(list(column)) for column in columns)]
                    writer.writerow([f"{value:.6f}" for value in row])
                    samples += 1
                    window = [state]
                    late = seconds is not None and last_s - first_s >= seconds
                    if late or stop() or until(state) or samples == MAX_ROWS:
                        break
        except UnreachableError as error:
            ended = str(error)
        except OSError as error:
            raise truncated(path, error, holds_a_row) from error
    return Recorded(str(path), last_s - first_s, samples, ended)


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)
