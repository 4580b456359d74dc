"""Recorder of trajectories: joint positions as a CSV file that `contactctl start` runs.

Lead the arm by hand, and let it do the same again. Recorded are the motors' positions at the link
side: a link that falls from one side of its gap to the other does what no motor can repeat.
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

# Each sample is the mean over this time [s]: short enough for a hand, and long enough that an
# encoder's last digit makes no acceleration.
SAMPLE_S = 0.05


@dataclass(frozen=True, slots=True)
class Recorded:
    """Result of `record_trajectory`."""

    path: str
    duration_s: float
    samples: int
    ended: str  # empty if it ended as asked, else why not

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
    """Write motor positions, at the link [rad], of all joints to a new CSV file until `stop()`,
    `until` a State, `seconds` have passed, it is as long as a trajectory may be, or no daemon is.
    `begun` is called once the recording has begun.

    Raises LogError if `path` exists or cannot be written (then it holds whole rows, or is gone),
    ControlError if there is no daemon to begin with.
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
