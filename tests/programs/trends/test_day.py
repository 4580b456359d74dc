"""Day records: written whole, read back, bounded; what is damaged is set aside."""

import math
from pathlib import Path

import pytest

from common.errors import LogError
from daemon.protocol.trend_row import trends_folder
from programs.trends import day as module
from programs.trends.day import Day, JointDay, Sum, read_days, write_day

LATE = "2100-01-01"


def record(date: str, moved_s: float = 60.0) -> Day:
    joint = JointDay(moved_s=moved_s)
    joint.friction.put(1.2, 30.0)
    return Day(arm="arm", date=date, joints={"elbow": joint})


def test_a_written_day_is_read(tmp_path: Path) -> None:
    for date in ("2026-06-04", "2026-06-03"):
        write_day(tmp_path / "new", record(date))
    found = read_days(tmp_path / "new", until=LATE)
    assert [day.date for day in found.days] == ["2026-06-03", "2026-06-04"]
    assert found.days[0] == record("2026-06-03")
    assert found.damaged == ()
    assert read_days(tmp_path / "none", until=LATE).days == ()


def test_sums_have_means() -> None:
    total = Sum()
    assert math.isnan(total.mean)
    for value, weight in ((2.0, 1.0), (5.0, 2.0), (math.nan, 1.0), (9.0, 0.0)):
        total.put(value, weight)
    assert (total.mean, total.weight) == (4.0, 3.0)


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", '{"arm": "arm", "date": "2026-06-05"}',
     '{"arm": "arm", "date": "2026-06-04", "x": 1}',
     '{"version": 2, "arm": "arm", "date": "2026-06-04"}', "\x00" * 100,
     '{"arm": "arm", "date": "2026-06-04", "joints": {"a": {"moved_s": -1}}}',
     '{"arm": "arm", "date": "2026-06-04", "joints": {"a": {"back": {"first": 1e300}}}}',
     '{"arm": "arm", "date": "2026-06-04", "joints": ' + 10_000 * "["],
    ids=["empty", "half", "list", "of another day", "unknown field", "version", "zeros",
         "negative time", "absurd sum", "deep"],
)  # fmt: skip
def test_a_damaged_record_is_set_aside_and_reported(tmp_path: Path, text: str) -> None:
    write_day(tmp_path, record("2026-06-03"))
    (tmp_path / "2026-06-04.json").write_text(text)
    looked = read_days(tmp_path, until=LATE)
    assert looked.damaged == (str(tmp_path / "2026-06-04.json"),)
    found = read_days(tmp_path, set_aside=True, until=LATE)
    assert [day.date for day in found.days] == ["2026-06-03"]
    assert found.damaged == (str(tmp_path / "2026-06-04.json.damaged"),)
    assert (tmp_path / "2026-06-04.json.damaged").read_text() == text
    # It is said as long as it is there, and a second one does not take its place.
    (tmp_path / "2026-06-04.json").write_text("{")
    assert len(read_days(tmp_path, set_aside=True, until=LATE).damaged) == 2


def test_an_invalid_day_is_damaged(tmp_path: Path) -> None:
    (tmp_path / "2026-06-31.json").write_text('{"arm": "arm", "date": "2026-06-31"}')
    assert read_days(tmp_path, until=LATE).damaged == (str(tmp_path / "2026-06-31.json"),)


def test_a_record_that_cannot_be_set_aside_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read_only(*_: object) -> None:
        raise OSError(30, "Read-only file system")

    (tmp_path / "2026-06-04.json").write_text("{")
    monkeypatch.setattr(Path, "rename", read_only)
    (said,) = read_days(tmp_path, until=LATE, set_aside=True).words
    assert said.endswith("2026-06-04.json: Read-only file system")


def test_future_days_and_unreadable_records_stay_and_are_left_out(tmp_path: Path) -> None:
    for date in ("2026-06-03", "2026-06-04", "2099-01-01"):
        write_day(tmp_path, record(date))
    (tmp_path / "2026-06-05.json").mkdir()
    found = read_days(tmp_path, until="2026-06-04", set_aside=True)
    assert [day.date for day in found.days] == ["2026-06-03", "2026-06-04"]
    assert found.damaged == ()
    unread, to_come = found.left_out
    assert unread.startswith(f"record cannot be read: {tmp_path}/2026-06-05.json: ")
    assert to_come.startswith("record of a future day (is the clock right?): ")
    assert len(list(tmp_path.iterdir())) == 4


def test_the_number_of_days_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "DAYS_KEPT", 3)
    for k in range(1, 7):
        write_day(tmp_path, record(f"2026-06-0{k}"))
    assert [day.date[-1] for day in read_days(tmp_path, until=LATE).days] == ["4", "5", "6"]
    assert len(list(tmp_path.iterdir())) == 3


def test_a_record_that_cannot_be_written_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_day(tmp_path, record("2026-06-03"))

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module.os, "fsync", full)
    with pytest.raises(LogError, match="No space left"):
        write_day(tmp_path, record("2026-06-03", 99.0))
    assert read_days(tmp_path, until=LATE).days == (record("2026-06-03"),)
    assert len(list(tmp_path.iterdir())) == 1


def test_each_arm_has_a_folder() -> None:
    assert trends_folder(Path("/s"), "Romeo left arm") == Path("/s/trends/romeo-left-arm")
    assert trends_folder(Path("/s"), "../..") == Path("/s/trends/arm")
