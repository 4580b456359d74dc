"""The process beside the daemon: rows in, records and warnings out; and the line to it."""

import json
import os
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from bench.rigs.lockstep import SINGLE_JOINT, lockstep_rig
from daemon.modes.table import Event
from daemon.service.trend_line import TrendLine, identified_dates
from programs.contactctl import contactctl
from programs.contactctl import health as health_command
from programs.trends.day import read_days, write_day
from programs.trends.writer import Job, Writer
from tests.programs.trends.test_day import LATE
from tests.programs.trends.test_findings import days, worn
from tests.programs.trends.test_gather import rows


def job(folder: Path) -> Job:
    return Job(
        folder=str(folder), arm="arm", joints=["elbow", "wrist"], period_s=0.01, identified={}
    )


def test_a_day_that_begins_again_goes_on(tmp_path: Path) -> None:
    for k in range(2):
        writer = Writer(job(tmp_path), lambda _: None)
        data = rows(50.0, tick=10_000 * k).tobytes()
        for part in (data[:1001], data[1001:99_999], data[99_999:]):  # as a pipe cuts them
            writer.take(part, 0.0)
        writer.end()
    (day,) = read_days(tmp_path, until=LATE).days
    assert day.joints["elbow"].friction.weight == pytest.approx(2 * 47.0, abs=3.0)


def test_samples_before_an_identification_are_left_out(tmp_path: Path) -> None:
    """While friction is a guess, learning stands at its bound, which is no evidence on the gear."""
    found = {"elbow": "2026-11-24T02:40:00+00:00"}
    for k, identified in enumerate(({}, found, found)):
        writer = Writer(msgspec.structs.replace(job(tmp_path), identified=identified), print)
        writer.take(rows(50.0, tick=10_000 * k).tobytes(), 0.0)
        writer.end()
        if not k:
            (first,) = read_days(tmp_path, until=LATE).days
    (day,) = read_days(tmp_path, until=LATE).days
    assert day.identified == found
    assert day.joints["elbow"].moved_s == pytest.approx(2.0 * first.joints["elbow"].moved_s)
    assert day.joints["wrist"].moved_s == pytest.approx(3.0 * first.joints["wrist"].moved_s)


def test_warnings_are_reported_once_and_when_they_change(tmp_path: Path) -> None:
    for day in days(11, worn):
        write_day(tmp_path, day)
    said: list[list[str]] = []
    writer = Writer(job(tmp_path), said.append)
    assert len(said) == 1
    assert said[0][0].startswith("LElbowRoll: friction +")
    writer.take(rows(20.0).tobytes(), 100.0)
    (tmp_path / "2026-06-30.json").write_text("{")
    writer.end()
    assert any(line.startswith("damaged record: ") for line in said[-1])


def test_a_folder_that_cannot_be_written_is_reported_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    writer = Writer(job(tmp_path / "file" / "below"), lambda _: None)
    for k in range(3):
        writer.take(rows(1.0, tick=1000 * k).tobytes(), 100.0 * k)
    assert sum("trends are not written" in message for message in caplog.messages) == 1


def test_the_daemon_sends_its_ticks_and_gets_the_warnings(tmp_path: Path) -> None:
    for day in days(11, worn):
        write_day(tmp_path, day)
    with lockstep_rig(SINGLE_JOINT) as rig:
        line = TrendLine(rig.robot, tmp_path)
        rig.enable()
        rig.request(Event.START)
        rig.run(20.0, lambda: line.put(rig.last, rig.tick.estimator))
        line.close()
        # Whatever it said until its end is in the pipe; the last listening finds it.
    found = read_days(tmp_path, until=LATE).days
    assert found[-1].arm == rig.robot.configuration.name
    assert 10.0 < found[-1].joints["joint"].moved_s < 20.0


def test_a_line_to_nothing_and_a_line_that_broke(tmp_path: Path) -> None:
    with lockstep_rig(SINGLE_JOINT) as rig:
        rig.enable()
        nothing = TrendLine(rig.robot, None)
        nothing.put(rig.last, rig.tick.estimator)
        nothing.close()
        broken = TrendLine(rig.robot, tmp_path)
        assert broken._process is not None
        process = broken._process
        process.kill()
        process.wait()
        broken.put(rig.last, rig.tick.estimator)
        assert broken._process is None
        broken.close()
        for end in (process.stdin, process.stdout):
            assert end is not None
            end.close()
        assert identified_dates(rig.robot) == {}


def health(*arguments: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(contactctl.main, ["health", *arguments], catch_exceptions=False)
    return result.exit_code, result.stdout, result.stderr


def test_health_for_a_person_a_program_and_a_picture(tmp_path: Path) -> None:
    folder = tmp_path / "trends" / "arm"
    where = ("--directory", str(tmp_path))
    code, _, error = health(*where)
    assert (code, "no records yet" in error) == (65, True)
    for day in days(11, worn):
        write_day(folder, day)
    (folder / "2026-06-02.json").write_text("{")
    code, out, _ = health(*where)
    assert code == 1
    assert "arm: 11 days, 2026-06-03 to 2026-06-13" in out
    assert "LElbowRoll: friction +2" in out
    head = next(line for line in out.splitlines() if "identified" in line)
    row = next(line for line in out.splitlines() if line.lstrip().startswith("shoulder"))
    for column, unit in (("gap", "mrad"), ("skew", "ms"), ("gravity", "Nm")):
        assert row[: head.index(column) + len(column)].split()[-2] == unit, (column, row)
    assert "damaged record: " in out
    code, out, _ = health(*where, "--json")
    (arm,) = json.loads(out)
    assert [joint["named"] for joint in arm["joints"]] == [[], ["friction", "gap"]]
    assert len(arm["damaged"]) == 1
    pytest.importorskip("matplotlib")
    assert health(*where, "--plot", str(tmp_path / "a.png"))[0] == 1
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert "exists" in health(*where, "--plot", str(tmp_path / "a.png"))[2]
    assert "must end in" in health(*where, "--plot", str(tmp_path / "a.txt"))[2]
    assert os.listdir(folder).count("2026-06-02.json") == 1  # a reader sets nothing aside


def test_records_of_which_none_can_be_read_are_not_well(tmp_path: Path) -> None:
    folder = tmp_path / "trends" / "arm"
    folder.mkdir(parents=True)
    (folder / "2026-06-02.json").write_text("{")
    code, out, _ = health("--directory", str(tmp_path))
    assert (code, "damaged record: " in out) == (65, True)
    assert health("--directory", str(tmp_path), "--json")[0] == 65


def test_gears_that_are_well_are_status_0(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for day in days(6, lambda k, r: worn(0, r), rng):
        write_day(tmp_path / "trends" / "arm", day)
    code, out, _ = health("--directory", str(tmp_path))
    assert (code, "no warnings for any joint" in out) == (0, True)


def test_health_of_a_service_that_may_not_be_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = tmp_path / ("x" * 300)  # refused to everybody, root too
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "own"))
    monkeypatch.setattr(health_command, "_SERVICE", service)
    code, _, error = health()
    assert code == 65
    assert error.strip().endswith(f"{service / 'trends'}: File name too long")
