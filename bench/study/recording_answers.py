"""Measurements of the commands that answer from recordings: time and memory. Long recordings are
copies of a real one, concatenated."""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer

from programs.clients.log_reader import PROFILE
from programs.clients.log_writer import CHUNK_BYTES
from programs.recordings.html import page_of
from programs.recordings.question import Answer, Question
from programs.recordings.view import read_view
from programs.recordings.whatif import ask

LEVELS: Final = 200
_PEAK: Final = """
import sys
from programs.contactd.contactd import main
try:
    main(sys.argv[1:])
finally:
    status = open("/proc/self/status").read()
    print(status.partition("VmHWM:")[2].split()[0], file=sys.stderr)
"""


def messages_of(path: Path) -> tuple[bytes, list[bytes]]:
    """Snapshot and States of a recording, as written."""
    snapshot, states = b"", []
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            if channel.topic == "/state":
                states.append(message.data)
            elif not snapshot:
                snapshot = message.data
    return snapshot, states


def write(path: Path, parts: Sequence[tuple[bytes, Sequence[bytes]]]) -> None:
    """Write a recording of these snapshots, each with its States."""
    with path.open("wb") as stream:
        log = Writer(stream, chunk_size=CHUNK_BYTES)
        log.start(profile=PROFILE)
        schema = log.register_schema("any", "jsonschema", b'{"type": "object"}')
        topics = {
            name: log.register_channel(name, "json", schema) for name in ("/snapshot", "/state")
        }
        for snapshot, states in parts:
            log.add_message(topics["/snapshot"], 0, snapshot, 0)
            for state in states:
                log.add_message(topics["/state"], 0, state, 0)
        log.finish()  # type: ignore[no-untyped-call]


def times(path: Path, joint: str, folder: Path) -> dict[str, float]:
    """Times for a recording [s]: LEVELS levels computed (CPU) and from the cache, and its page,
    with its size."""
    question = Question(levels={joint: tuple(np.linspace(0.1, 4.0, LEVELS).tolist())})
    cache = Path(tempfile.mkdtemp(dir=folder))
    cpu_s = time.process_time()
    first = _answered(ask(path, question, cache=cache))
    cpu_s = time.process_time() - cpu_s
    begun = time.perf_counter()
    second = _answered(ask(path, question, cache=cache))
    cached_s = time.perf_counter() - begun
    assert first == second
    begun = time.perf_counter()
    page = page_of(read_view(path)).encode()
    plot_s = time.perf_counter() - begun
    mb = len(page) / 1e6
    return {"whatif_cpu_s": cpu_s, "cached_s": cached_s, "plot_s": plot_s, "page_mb": mb}


def _answered(answer: Answer) -> Answer:
    assert not answer.failed, answer.failed
    return answer


def peak_mb(arguments: Sequence[object], folder: Path) -> float:
    """Peak memory of `contactd ...` [MB], in a process of its own with a new cache. The process
    reports it itself: the kernel's figure for a child includes its parent."""
    cache = tempfile.mkdtemp(dir=folder)
    process = subprocess.run(
        [sys.executable, "-c", _PEAK, *map(str, arguments)],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "XDG_CACHE_HOME": cache},
        check=False,
    )
    shutil.rmtree(cache)
    assert process.returncode in (0, 1), process.stderr
    return int(process.stderr.split()[-1]) / 1024.0


def growth_mb(short: Path, long: Path, joint: str, folder: Path) -> dict[str, float]:
    """Additional memory of each command for the longer recording [MB]."""
    page = folder / "page.html"
    commands: dict[str, list[object]] = {
        "replay": ["replay"],
        "plot": ["plot", "-o", page],
        "whatif": ["whatif", "--threshold", f"{joint}=0.1:4:0.02"],
    }
    return {
        name: peak_mb([*command, long], folder) - peak_mb([*command, short], folder)
        for name, command in commands.items()
    }
