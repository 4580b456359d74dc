"""States from the black box's frames: the daemon's own samples, estimated anew, with its faults."""

import os
import shutil
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from bench.rigs.lockstep import SINGLE_JOINT, lockstep_rig
from common.errors import LogError
from daemon.protocol.state import State
from daemon.service.black_box_log import Context, context_of_log, context_path, save
from daemon.service.status import context_of
from drivers.can.frame_ring import FrameRing, RecordedWire
from programs.clients.log_reader import read_log
from programs.contactd.contactd import main
from programs.recordings.recomputed import as_recording, last_fault, recomputed

SECONDS = 2.0


@pytest.fixture(autouse=True)
def _homes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)


@pytest.fixture
def run(tmp_path: Path) -> tuple[Path, list[State]]:
    """A log of an arm that is enabled, with a fault, and what the daemon said meanwhile."""
    now = [0.0]
    path = tmp_path / "control.frames"
    ring = FrameRing(path, 20_000, lambda: now[0])
    states: list[State] = []
    with lockstep_rig(SINGLE_JOINT, between=lambda wire: RecordedWire(wire, ring)) as rig:

        def each() -> None:
            now[0] = rig.time_s
            states.append(rig.state())

        rig.run(0.1, lambda: now.__setitem__(0, rig.time_s))
        rig.run(SECONDS, each)
        context_path(path).write_bytes(msgspec.json.encode(context_of(rig.robot)))
    begun_wall_s = time.time()
    log = save(path, tmp_path / "state" / "contactd", [(begun_wall_s + 3600.0, "the bus is gone")])
    ring.close()
    assert log is not None
    return log, states


def context_beside(log: Path) -> Context:
    return msgspec.json.decode(context_of_log(log).read_bytes(), type=Context)


def with_fault(log: Path, after: int) -> None:
    """Let the daemon have reported a fault when it sent that SYNC."""
    _, states = recomputed(log, context_of_log(log))
    reported = context_beside(log)
    fault = (states[after].timing.wall_s - 1e-3, "drive fault: joint")
    context_of_log(log).write_bytes(msgspec.json.encode(Context(reported.snapshot, [fault])))


def test_the_samples_are_those_of_the_daemon(run: tuple[Path, list[State]]) -> None:
    log, states = run
    snapshot, found = recomputed(log, context_of_log(log))
    assert snapshot.joints == ["joint"]
    assert len(found) >= len(states) - 2
    pairs = list(zip(found[::-1], states[::-1], strict=False))[: len(states) - 5]
    for name in ("current", "link_position", "motor_velocity", "drives", "fresh"):
        assert [getattr(a, name) for a, _ in pairs] == [getattr(b, name) for _, b in pairs]
    residual = np.array([[a.residual[0], b.residual[0]] for a, b in pairs])
    assert np.abs(residual[:, 0] - residual[:, 1]).max() < 0.05


def test_it_is_opened_like_a_recording_at_its_fault(
    run: tuple[Path, list[State]], tmp_path: Path
) -> None:
    log, _ = run
    with_fault(log, after=100)
    page = tmp_path / "a.html"
    answer = CliRunner().invoke(main, ["plot", "--last-fault", "-o", str(page)])
    assert answer.exit_code == 0, answer.output
    assert "with higher thresholds" in answer.output
    assert "at 1.0" in answer.output
    assert page.exists()
    reported = CliRunner().invoke(main, ["replay", str(log)])
    assert "drive fault: joint" in reported.output
    assert "no estimate to compare with" in reported.stderr
    assert reported.exit_code == 65
    answer = CliRunner().invoke(main, ["whatif", str(log), "--fresh"])
    assert answer.exit_code == 0, answer.output
    assert answer.output.startswith(f"{log}: ")


def test_a_fault_after_the_last_frame_is_shown(run: tuple[Path, list[State]]) -> None:
    log, _ = run
    assert [text for _, text in context_beside(log).faults] == ["the bus is gone"]
    _, states = recomputed(log, context_of_log(log))
    assert [k for k, state in enumerate(states) if state.notices] == [len(states) - 1]
    assert [notice.text for notice in states[-1].notices] == ["the bus is gone"]


def test_the_last_fault_is_of_the_newest_log_with_one(run: tuple[Path, list[State]]) -> None:
    log, _ = run
    newer = log.with_name("frames-99991231T000000.000Z.blf")
    newer.write_bytes(log.read_bytes())
    context_of_log(newer).write_bytes(msgspec.json.encode(Context(context_beside(log).snapshot)))
    assert last_fault() == log
    context_of_log(log).unlink()
    assert last_fault() == newer


def plotted(*arguments: object) -> Any:
    return CliRunner().invoke(main, ["plot", *map(str, arguments)])


def test_missing_files_are_reported(run: tuple[Path, list[State]], tmp_path: Path) -> None:
    log, _ = run
    context_of_log(log).write_bytes(b"{")
    assert "cannot be read" in plotted(log).stderr
    context_of_log(log).unlink()
    assert "describes its frames, is not beside it" in plotted(log).stderr
    log.unlink()
    answer = plotted("--last-fault")
    assert answer.exit_code == 65
    assert "there is no black-box log in" in answer.stderr
    assert plotted().exit_code == 2
    assert plotted("--last-fault", "x.mcap").exit_code == 2


def test_a_log_that_is_damaged_gets_one_line(run: tuple[Path, list[State]]) -> None:
    log, _ = run
    log.write_bytes(b"LOGG" + bytes(200))
    with pytest.raises(LogError) as caught:
        as_recording(log)
    assert str(log) in str(caught.value)


def test_the_least_recently_used_recording_is_deleted(
    run: tuple[Path, list[State]], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = as_recording(run[0])
    size, root = made.stat().st_size, made.parents[1]
    for days in (1, 2):
        other = root / f"{days}" / "log.mcap"
        other.parent.mkdir()
        other.write_bytes(bytes(size))
        os.utime(other.parent, (days * 1e5, days * 1e5))
    monkeypatch.setattr("programs.recordings.row_cache.MOST_BYTES", 2 * size)
    shutil.rmtree(made.parent)
    assert as_recording(run[0]) == made
    assert {folder.name for folder in root.iterdir()} == {made.parent.name, "2"}


def test_the_recording_is_one_of_ours(run: tuple[Path, list[State]]) -> None:
    log, _ = run
    recording = as_recording(log)
    assert recording.stem == log.stem
    messages = list(read_log(recording))
    assert len(messages) > 150


def test_help_says_which_log_is_of_the_last_fault() -> None:
    said = " ".join(CliRunner().invoke(main, ["plot", "--help"]).stdout.split())
    assert "newest black-box log that has a fault" in said
