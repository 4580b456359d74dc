"""Export of recordings to a LeRobot dataset, written by the plug-in `lerobot_robot_contactd` in
LeRobot's own environment, so that LeRobot is not needed here."""

import glob
import math
import os
import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Final

import msgspec

from common.errors import LogError
from daemon.modes.table import Mode
from daemon.protocol.state import Snapshot, State
from programs.clients.log_reader import read_batches

WRITER: Final = "contactd-lerobot-dataset"
BUILT: Final = Path("build/lerobot/bin")
"""Folder of programs in the environment that `make lerobot` builds."""
MODES: Final = [str(mode) for mode in Mode]


def writer() -> Path:
    """Path of the program that writes the dataset. Raises LogError if it is not installed."""
    chosen = os.environ.get("CONTACTD_LEROBOT")
    folders = [Path(chosen) / "bin"] if chosen else [BUILT]
    for folder in folders:
        if (folder / WRITER).is_file():
            return folder / WRITER
    if not chosen and (found := shutil.which(WRITER)):
        return Path(found)
    raise LogError(
        f"--lerobot needs LeRobot's environment, with {WRITER}: build it by `make lerobot`, or set "
        "CONTACTD_LEROBOT to yours (docs/lerobot.md)"
    )


def export_lerobot(
    files: Sequence[Path],
    target: Path,
    fps: int,
    task: str,
    progress: Callable[[float], None] = lambda share: None,
) -> str:
    """Write recordings, with the videos beside them, as episodes of a new dataset in the folder
    `target`; returns why recordings end early, or empty. Raises LogError, also if their joints or
    cameras differ."""
    program, cameras = writer(), cameras_of(files)
    broken: list[str] = []
    running = subprocess.Popen([program, target], stdin=subprocess.PIPE)
    assert running.stdin is not None
    try:
        with suppress(BrokenPipeError), running.stdin:  # the writer itself prints why it ended
            frames = Frames(running.stdin, fps, task, cameras)
            for number, file in enumerate(files):
                frames.begin(file, number)
                broken.append(read_batches(file, frames.take, progress))
    except BaseException:
        running.kill()
        raise
    finally:
        running.wait()
    if running.returncode:
        raise LogError(f"{target}: no dataset: {program.name} ended with {running.returncode}")
    return "; ".join(filter(None, broken))


def cameras_of(files: Sequence[Path]) -> dict[str, list[str]]:
    """Videos beside recordings, `RECORDING.CAMERA.mp4`, by camera, one per recording. Raises
    LogError if a recording lacks a camera that another has."""
    found = []
    for file in files:
        beside = file.parent.glob(f"{glob.escape(file.stem)}.*.mp4")
        found.append({path.name[len(file.stem) + 1 : -len(".mp4")]: str(path) for path in beside})
    names = sorted(set().union(*found))
    for file, videos in zip(files, found, strict=True):
        for name in names:
            if name not in videos:
                missing = file.with_name(f"{file.stem}.{name}.mp4")
                raise LogError(f"{missing} is missing: other recordings have a camera {name!r}")
    return {name: [videos[name] for videos in found] for name in names}


class Frames:
    """Writer of frames as lines of JSON at a constant rate, each from the first State due."""

    def __init__(
        self, out: IO[bytes], fps: int, task: str, cameras: Mapping[str, Sequence[str]]
    ) -> None:
        self._out, self._fps, self._task, self._cameras = out, fps, task, cameras
        self._joints: list[str] = []
        self._file, self._episode, self._due_s = Path(), 0, math.nan
        self._begun_s = 0.0

    def begin(self, file: Path, episode: int) -> None:
        """Start the episode of a file."""
        self._file, self._episode, self._due_s = file, episode, math.nan

    def take(self, batch: Snapshot | list[State]) -> None:
        """Write the frames of a batch of the recording."""
        if isinstance(batch, Snapshot):
            self._head(batch)
            return
        for state in batch:
            if math.isnan(self._due_s):
                self._due_s = self._begun_s = state.time_s
            if state.time_s >= self._due_s - 1e-6:
                self._write(frame(state, self._episode, self._due_s - self._begun_s))
                self._due_s += 1.0 / self._fps

    def _head(self, snapshot: Snapshot) -> None:
        if self._joints and snapshot.joints != self._joints:
            raise LogError(
                f"{self._file}: its joints are {', '.join(snapshot.joints)}; those of the first "
                f"recording are {', '.join(self._joints)}: a dataset must be of one arm"
            )
        if not self._joints:
            self._joints = snapshot.joints
            head = {"joints": self._joints, "fps": self._fps, "task": self._task}
            self._write({**head, "cameras": self._cameras})

    def _write(self, line: dict[str, object]) -> None:
        self._out.write(msgspec.json.encode(line) + b"\n")


def frame(state: State, episode: int, time_s: float) -> dict[str, object]:
    """Frame of a State, `time_s` after the start of its episode: the observation as
    `lerobot-record` makes it, and as action the reference that the arm followed."""
    contact = float(any(state.thresholded))
    observation = [
        *state.link_position, *state.link_velocity, *state.residual, *state.threshold,
        contact, float(MODES.index(str(state.mode))),
    ]  # fmt: skip
    return {
        "episode": episode,
        "time_s": time_s,
        "observation": observation,
        "action": state.reference,
    }
