"""Recordings made from the page: bounded in duration and size, in one folder.

`clients/recorder.py` writes them in a thread, in the format of `contactctl record`.
"""

import asyncio
import re
import shutil
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from common.errors import ContactdError, LogError
from programs.clients.client import Client
from programs.clients.recorder import Recording, record
from programs.web.words import RecordedFile, Recordings

LONGEST_S: Final = 600.0
MOST_BYTES: Final = 256 << 20  # size limit of one file
ROOM_BYTES: Final = 1 << 30  # size limit of all files
DISK_LEFT_BYTES: Final = 1 << 30  # left free for others
LOOKS_EVERY: Final = 50  # ticks between checks of the limits
_NAME: Final = re.compile(r"[A-Za-z0-9_.-]+\.mcap")


@dataclass(slots=True)
class _Running:
    """Recording in progress."""

    path: Path
    begun_s: float
    most_bytes: int
    stop: threading.Event = field(default_factory=threading.Event)
    bound: str = ""  # words on the limit that ended it
    done: "asyncio.Future[Recording] | None" = None


class Recorder:
    """Recorder into `folder`, which is created when needed; makes one recording at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._running: _Running | None = None
        self._said = ""

    def start(self, view_socket: Path, arm: str) -> None:
        """Start to record the States of a daemon. Raises LogError if another recording is in
        progress, or there is no room."""
        if self._running is not None:
            raise LogError(f"{self._running.path.name} is being recorded")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            room = self._room()
        except OSError as error:
            raise LogError(f"cannot write {self.folder}: {error.strerror}") from error
        if room < MOST_BYTES // 4:
            raise LogError(f"no room in {self.folder}: delete recordings first")
        name = re.sub(r"[^A-Za-z0-9_-]+", "_", arm)[:40] or "arm"
        path = self.folder / f"{name}-{time.strftime('%Y%m%d-%H%M%S')}.mcap"
        running = _Running(path, time.monotonic(), min(MOST_BYTES, room))
        self._running, self._said = running, ""
        running.done = asyncio.get_running_loop().run_in_executor(
            None, _record, view_socket, running
        )
        running.done.add_done_callback(self._ended)

    def stop(self) -> None:
        """End the recording in progress, if any."""
        if self._running is not None:
            self._running.stop.set()

    async def close(self) -> None:
        """End the recording in progress, and wait until its file is complete."""
        self.stop()
        if self._running is not None and self._running.done is not None:
            await asyncio.wait([self._running.done])

    def _ended(self, done: "asyncio.Future[Recording]") -> None:
        running, self._running = self._running, None
        assert running is not None
        name = running.path.name
        try:
            made = done.result()
        except (ContactdError, OSError) as error:
            self._said = f"{name}: {error}"
            return
        lost = f", {made.lost} ticks lost" if made.lost else ""
        why = f"; {ended}" if (ended := made.ended or running.bound) else ""
        self._said = f"{name}: {made.duration_s:.1f} s, {made.states} states{lost}{why}"

    def shown(self) -> Recordings:
        """Message for the page on all recordings, newest first."""
        files = sorted(self._files(), key=_modified, reverse=True)
        running = self._running
        try:
            room = self._room()
        except OSError:
            room = 0
        return Recordings(
            running=running.path.name if running else "",
            seconds=time.monotonic() - running.begun_s if running else 0.0,
            bytes=_size(running.path) if running else 0,
            files=[
                RecordedFile(path.name, _size(path))
                for path in files
                if running is None or path != running.path
            ],
            room_bytes=room,
            said=self._said,
        )

    def file(self, name: str) -> Path | None:
        """Path of a complete recording of this name; None if there is none."""
        running = self._running.path.name if self._running else ""
        if name == running or not _NAME.fullmatch(name):
            return None
        return next((path for path in self._files() if path.name == name), None)

    def _files(self) -> list[Path]:
        if not self.folder.is_dir():
            return []
        return [path for path in self.folder.glob("*.mcap") if path.is_file()]

    def _room(self) -> int:
        """Bytes that recordings may still take. Raises OSError if the folder cannot be read."""
        place = self.folder
        while not place.exists():
            place = place.parent
        free = shutil.disk_usage(place).free - DISK_LEFT_BYTES
        return max(min(free, ROOM_BYTES - sum(_size(path) for path in self._files())), 0)


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _modified(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def _bound(running: _Running) -> str:
    """Words on the limit that a recording has reached; empty if none."""
    if time.monotonic() - running.begun_s >= LONGEST_S:
        return f"ended after {LONGEST_S / 60:.0f} minutes, the maximum length"
    if _size(running.path) >= running.most_bytes:
        return f"ended at {running.most_bytes / 1e6:.1f} MB, the maximum size"
    if shutil.disk_usage(running.path.parent).free < DISK_LEFT_BYTES:
        return f"ended: the last {DISK_LEFT_BYTES / 1e9:.1f} GB of the disk are reserved"
    return ""


def _record(view_socket: Path, running: _Running) -> Recording:
    ticks = 0

    def stop() -> bool:
        nonlocal ticks
        ticks += 1
        if ticks % LOOKS_EVERY == 0:
            running.bound = _bound(running)
        return running.bound != "" or running.stop.is_set()

    return record(lambda: Client(view_socket), running.path, stop=stop)
