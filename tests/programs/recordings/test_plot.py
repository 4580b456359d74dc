"""Plots: gathering loses no peak, and the page is complete without a network."""

import base64
import dataclasses
import hashlib
import json
import math
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.protocol.state import Notice, State
from programs.contactd.contactd import main
from programs.recordings import html
from programs.recordings.html import page_of
from programs.recordings.signals import DRAWN, SignalGatherer
from programs.recordings.view import _gatherer, read_view
from tests.examples import scaled
from tests.fake_daemon import JOINTS, snapshot_at, state_at
from tests.programs.clients.test_recorder import FORMATS
from tests.programs.clients.test_replay import written

N = len(JOINTS)


def gathered(states: list[State], most: int, part: int = 32, **window: float) -> SignalGatherer:
    gatherer = SignalGatherer(N, most, **window)
    for k in range(0, len(states), part):
        gatherer.add(states[k : k + part])
    return gatherer


def test_where_there_is_room_every_tick_is_there() -> None:
    states = [state_at(tick) for tick in range(100)]
    signals = gathered(states, most=100).signals()
    assert signals.ticks_per_bucket == 1
    for name in DRAWN:
        expected = np.array([getattr(state, name) for state in states], dtype=np.float32)
        np.testing.assert_array_equal(signals.values[name], expected)


@settings(max_examples=scaled(30), deadline=None)
@given(ticks=st.integers(1, 900), most=st.integers(2, 40), part=st.integers(1, 70))
def test_no_peak_is_lost_and_the_number_of_points_is_bounded(
    ticks: int, most: int, part: int
) -> None:
    states = [state_at(tick) for tick in range(ticks)]
    signals = gathered(states, most, part).signals()
    assert len(signals.time_s) <= 4 * most + 2
    assert (np.diff(signals.time_s) >= 0.0).all()
    residual = np.array([state.residual for state in states], dtype=np.float32)
    np.testing.assert_array_equal(signals.values["residual"].min(axis=0), residual.min(axis=0))
    np.testing.assert_array_equal(signals.values["residual"].max(axis=0), residual.max(axis=0))


def test_no_line_is_drawn_across_what_is_missing() -> None:
    states = [state_at(tick) for tick in (1, 2, 3, 9, 10)]
    values = gathered(states, most=50).signals().values["phi"][:, 0]
    assert np.isnan(values).tolist() == [False, False, False, True, False, False]


def test_modes_are_spans_without_a_gap() -> None:
    states = [state_at(tick) for tick in range(90, 220)]
    modes = gathered(states, most=50).signals().modes
    assert [span.mode for span in modes] == ["tracking", "admittance", "tracking"]
    assert [span.end_s for span in modes[:-1]] == [span.begin_s for span in modes[1:]]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A contact of the second joint from 0.1 to 1.1 s, then a fault."""
    fault = Notice(kind="fault", text="encoder </script> jumps")
    states = [state_at(tick) for tick in range(90, 300)]
    states[150] = state_at(240, notices=[fault])
    return written(tmp_path / "made.mcap", [snapshot_at(89), *states])


def data_of(page: Path) -> Any:
    text = page.read_text(encoding="utf-8")
    (data,) = re.findall(r'id="data">(.*?)</script>', text, re.DOTALL)
    return json.loads(data)


def plotted(*arguments: object) -> Any:
    return CliRunner().invoke(main, ["plot", *map(str, arguments)])


def test_the_page_has_the_values_and_asks_for_nothing(recording: Path, tmp_path: Path) -> None:
    page = tmp_path / "a.html"
    assert plotted(recording, "-o", page).exit_code == 0
    text = page.read_text(encoding="utf-8")
    assert not re.search(r'(src|href)\s*=\s*["\']', text)
    assert "default-src 'none'" in text
    data = data_of(page)
    assert [joint["name"] for joint in data["joints"]] == JOINTS
    assert [joint["name"] for joint in data["joints"] if joint["shown"]] == [JOINTS[1]]
    assert [event["kind"] for event in data["events"]] == ["contact", "fault"]
    one = data["joints"][1]["signals"]["residual"]
    codes = np.frombuffer(base64.b64decode(one["codes"]), dtype="<i2")
    values = one["offset"] + one["scale"] * codes
    expected = [state_at(tick).residual[1] for tick in range(90, 300)]
    np.testing.assert_allclose(values, expected, atol=one["scale"])


@pytest.mark.parametrize(
    ("around", "at_s"), [("0.5", 0.5), ("contact:1", 0.1), ("fault", 1.5), ("fault:1", 1.5)]
)
def test_around_shows_a_window_and_lists_the_values_there(
    recording: Path, tmp_path: Path, around: str, at_s: float
) -> None:
    page = tmp_path / "a.html"
    answer = plotted(recording, "--joint", "2", "--around", around, "--window", 1, "-o", page)
    assert answer.exit_code == 0
    assert answer.output.startswith(f"at {at_s:.2f} s: ")
    assert f"  {JOINTS[1]} " in answer.output
    assert (" beyond its threshold" in answer.output) == (at_s < 1.1)
    data = data_of(page)
    assert data["at_s"] == pytest.approx(at_s)
    time_s = np.frombuffer(base64.b64decode(data["time"]), dtype="<f8")
    assert time_s.min() >= at_s - 0.5
    assert time_s.max() <= at_s + 0.5


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["--around", "contact:2"], 65, "--around contact:2: the recording has 1 contact"),
        (["--around", "99"], 65, "has no state at 99 s: it lasts 2.09 s"),
        (["--around", "contact:0"], 2, "is not a time in seconds"),
        (["--joint", "LElbow"], 65, "--joint LElbow: no such joint; there are: LShoulderPitch"),
        (["-o", "a.pdf"], 65, "must end in .html, .png or .svg"),
        (["-o", "/nonexistent/a.html"], 65, "cannot write /nonexistent/a.html"),
    ],
)
def test_wrong_options_are_refused(
    recording: Path, arguments: list[str], status: int, said: str
) -> None:
    answer = plotted(recording, *arguments)
    assert answer.exit_code == status
    assert said in answer.stderr


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_pictures_are_written(recording: Path, tmp_path: Path, suffix: str) -> None:
    target = tmp_path / f"a{suffix}"
    assert plotted(recording, "-o", target).exit_code == 0
    assert target.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("missing", "said"),
    [
        (("matplotlib",), f"install it by `{sys.executable} -m pip install matplotlib`"),
        (
            ("matplotlib", "pip"),
            f"{sys.prefix} belongs to the service and takes no further packages",
        ),
    ],
)
def test_a_missing_matplotlib_is_reported_with_the_command_to_install_it(
    recording: Path, tmp_path: Path, monkeypatch: Any, missing: tuple[str, ...], said: str
) -> None:
    for name in missing:
        monkeypatch.setitem(sys.modules, name, None)
    target = tmp_path / "a.png"
    answer = plotted(recording, "-o", target)
    assert (answer.exit_code, target.exists()) == (65, False)
    assert "a.png: a plot needs matplotlib; write an .html, which needs none, or" in answer.stderr
    assert said in answer.stderr
    assert plotted(recording, "-o", tmp_path / "a.html").exit_code == 0


@pytest.mark.parametrize("version", FORMATS)
def test_a_recording_of_each_format_is_plotted(version: int, tmp_path: Path) -> None:
    page = tmp_path / "a.html"
    assert plotted(FORMATS[version], "-o", page).exit_code == 0
    assert len(data_of(page)["joints"]) == 1


def test_the_whole_part_of_a_broken_file_is_plotted(recording: Path, tmp_path: Path) -> None:
    cut, page = tmp_path / "cut.mcap", tmp_path / "a.html"
    long = [state_at(tick) for tick in range(600)]
    whole = written(tmp_path / "long.mcap", [snapshot_at(-1), *long]).read_bytes()
    cut.write_bytes(whole[: len(whole) * 3 // 4])
    answer = plotted(cut, "-o", page)
    assert answer.exit_code == 1
    assert "ends in the middle" in answer.stderr
    assert 0.0 < data_of(page)["until_s"] < 5.9


def test_an_hour_stays_below_5_MB(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", [snapshot_at(-1), *(state_at(k) for k in range(40))])
    view = read_view(path)
    gatherer = _gatherer(path, snapshot_at(-1), (), 0.0, math.inf)
    rows = np.random.default_rng(1).normal(size=(360_000, 1)) * np.ones(N * len(DRAWN))
    for k in range(0, len(rows), 1000):
        gatherer._add_rows(0.01 * np.arange(k, k + 1000), rows[k : k + 1000].astype(np.float32))
    page = page_of(dataclasses.replace(view, signals=gatherer.signals()))
    assert len(page.encode()) < 5_000_000


def test_uplot_is_the_file_of_its_release() -> None:
    """`make uplot` fetches it; no hand changes it."""
    folder = Path(html.__file__).with_name("uplot")
    listed = [line.split() for line in (folder / "SHA256SUMS").read_text().splitlines()]
    assert {name for _, name in listed} == {"uPlot.iife.min.js", "uPlot.min.css", "LICENSE"}
    for digest, name in listed:
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest
