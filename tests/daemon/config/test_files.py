"""Files that a daemon runs by, looked at between two ticks: a bounded piece in each look."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from daemon.config import files
from daemon.config.files import PIECE_BYTES, Files, _content

ROW = b"0.01,0.123456,0.234567\r\n"
LARGE = ROW * (5 * PIECE_BYTES // len(ROW))


@pytest.fixture
def looked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Bytes read by each read of a file."""
    read: list[int] = []
    opened = files.open_regular

    class Counting:
        def __init__(self, path: Path) -> None:
            self._stream = opened(path)

        def __enter__(self) -> "Counting":
            return self

        def __exit__(self, *_: object) -> None:
            self._stream.close()

        def fileno(self) -> int:
            return self._stream.fileno()

        def seek(self, offset: int) -> None:
            self._stream.seek(offset)

        def read(self, size: int) -> bytes:
            read.append(size)
            return self._stream.read(size)

    monkeypatch.setattr(files, "open_regular", Counting)
    return read


def files_of(folder: Path, *names: str) -> Files:
    """Files that were read as they are."""
    return Files(folder, {name: _content(folder / name) for name in names})


def looks_until_settled(found: Files, name: str) -> int:
    """Looks after the first, until it is known whether a file has changed."""
    looks = 0
    while found._reading is not None and looks < 100:
        assert found.changed() == [name] or found._reading is None
        found.look_on()
        looks += 1
    return looks


@pytest.mark.parametrize(
    ("written", "changed"),
    [
        (lambda content: content, False),
        (lambda content: content.replace(b"\r\n", b"\n"), False),
        (lambda content: content.replace(b"\r\n", b"\r"), False),
        (lambda content: content[:-3] + b"8\r\n", True),
        (lambda content: b"1" + content[1:], True),
        (lambda content: content + ROW, True),
    ],
)
def test_a_large_file_is_compared_piece_by_piece(
    tmp_path: Path, looked: list[int], written: Callable[[bytes], bytes], changed: bool
) -> None:
    path = tmp_path / "way.csv"
    path.write_bytes(LARGE)
    found = files_of(tmp_path, path.name)
    path.write_bytes(written(LARGE))
    looked.clear()
    assert found.changed() == [path.name]  # until its end was seen
    assert 1 <= looks_until_settled(found, path.name) <= 6
    assert found.changed() == ([path.name] if changed else [])
    assert set(looked) == {PIECE_BYTES}


def test_a_small_file_is_known_at_once(tmp_path: Path) -> None:
    path = tmp_path / "config.yaml"
    path.write_bytes(b"version: 1\n")
    found = files_of(tmp_path, path.name)
    assert found.changed() == []
    path.write_bytes(b"version: 2\n")
    assert found.changed() == [path.name]
    path.write_bytes(b"version: 1\n")
    os.utime(path, ns=(1, 1))
    assert found.changed() == []
    path.unlink()
    assert found.changed() == [path.name]


def test_a_file_written_again_during_the_comparison_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "way.csv"
    path.write_bytes(LARGE)
    found = files_of(tmp_path, path.name)
    path.write_bytes(LARGE[:-3] + b"8\r\n")
    assert found.changed() == [path.name]
    path.write_bytes(LARGE)
    os.utime(path, ns=(1, 1))
    looks_until_settled(found, path.name)
    assert found.changed() == []


def test_two_large_files_are_compared_one_after_the_other(tmp_path: Path) -> None:
    names = ["a.csv", "b.csv"]
    for name in names:
        (tmp_path / name).write_bytes(LARGE)
    found = files_of(tmp_path, *names)
    for name in names:
        os.utime(tmp_path / name, ns=(1, 1))
    for _ in range(20):
        found.changed()
        found.look_on()
    assert found.changed() == []
