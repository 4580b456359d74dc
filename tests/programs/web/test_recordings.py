"""Recordings from the page: made, downloaded, deleted, and bounded."""

from pathlib import Path
from typing import Any

import pytest

from tests.programs.web.visitor import visited

FakeDaemon = Any  # of tests/fake_daemon.py


async def test_a_recording_is_made_downloaded_and_deleted(
    fake_daemon: FakeDaemon, tmp_path: Path
) -> None:
    async with visited(fake_daemon, recordings=tmp_path / "made") as visitor:
        await visitor.until(lambda: visitor.site.arms[0].snapshot)
        status, shown = await visitor.command("/arms/0/record")
        name = shown["running"]
        assert (status, name.startswith("Romeo_left_arm-")) == (200, True)
        assert (await visitor.command("/arms/0/record"))[0] == 409
        assert (await visitor.ask("GET", f"/recordings/{name}"))[0] == 404  # not complete yet
        await visitor.until(lambda: visitor.site.recorder.shown().bytes > 10_000)  # type: ignore[union-attr]
        _, shown = await visitor.command("/recordings/end")
        assert [file["name"] for file in shown["files"]] == [name]
        assert "states" in shown["said"]
        async with visitor.session.get(f"{visitor.origin}/recordings/{name}") as answer:
            data = await answer.read()
            assert answer.headers["Content-Disposition"] == f'attachment; filename="{name}"'
        assert data.startswith(b"\x89MCAP")
        assert data.endswith(b"\x89MCAP0\r\n")
        for wrong in ("..%2F..%2Fsecret.mcap", "other.mcap", "%2Fetc%2Fpasswd"):
            assert (await visitor.ask("GET", f"/recordings/{wrong}"))[0] == 404
        _, shown = await visitor.command(f"/recordings/{name}/delete")
        assert shown["files"] == []


@pytest.mark.parametrize(
    ("bound", "value", "why"),
    [
        ("LONGEST_S", 0.1, "minutes, the maximum length"),
        ("DISK_LEFT_BYTES", 1 << 60, "ended: the last"),
    ],
)
async def test_a_recording_that_reached_its_bound_is_reported(
    fake_daemon: FakeDaemon, tmp_path: Path, monkeypatch: Any, bound: str, value: float, why: str
) -> None:
    async with visited(fake_daemon, recordings=tmp_path) as visitor:
        await visitor.until(lambda: visitor.site.arms[0].snapshot)
        assert (await visitor.command("/arms/0/record"))[0] == 200
        monkeypatch.setattr(f"programs.web.recordings.{bound}", value)
        recorder = visitor.site.recorder
        assert recorder is not None
        await visitor.until(lambda: not recorder.shown().running)
        assert why in recorder.shown().said
        assert "states" in recorder.shown().said  # and the file is complete


async def test_a_recording_never_fills_the_disk(
    fake_daemon: FakeDaemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("programs.web.recordings.MOST_BYTES", 200_000)
    monkeypatch.setattr("programs.web.recordings.ROOM_BYTES", 230_000)
    async with visited(fake_daemon, recordings=tmp_path) as visitor:
        await visitor.until(lambda: visitor.site.arms[0].snapshot)
        assert (await visitor.command("/arms/0/record"))[0] == 200
        recorder = visitor.site.recorder
        assert recorder is not None
        await visitor.until(lambda: not recorder.shown().running)
        (file,) = recorder.shown().files
        assert 100_000 < file.bytes < 400_000
        assert "the maximum size" in recorder.shown().said
        status, text = await visitor.command("/arms/0/record")
        assert status == 409
        assert "no room" in text
