"""Benches run small: the command itself, from its options to its targets."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from bench import identification, logs, makes, masses, oracle, reaction
from bench.rigs.faults import PLACES, SHOWN
from bench.rigs.lockstep import DESK_ARM
from bench.study.masses import MassesFound, MassesJob
from tests.bench.reports import reported


def unmet(report: dict[str, Any]) -> list[str]:
    return [target["name"] for target in report["targets"] if not target["met"]]


def test_reaction(monkeypatch: pytest.MonkeyPatch) -> None:
    few = {"drive restarts", "one late tick", "8 late ticks"}
    shown = tuple(s for s in SHOWN if s.place == PLACES[0] and s.case.name in few)
    monkeypatch.setattr(reaction, "PLACES", PLACES[:1])
    monkeypatch.setattr(reaction, "SHOWN", shown)
    report = reported(reaction)
    faults = {row["fault"] for row in report["data"]["rows"]}
    assert faults == few | {"exception in the tick", "daemon killed"}
    assert unmet(report) == []


def test_reaction_to_pairs() -> None:
    report = reported(reaction, "--part pairs --sample 1")
    assert len(report["data"]["rows"]) == 1
    assert unmet(report) == []


def test_makes() -> None:
    report = reported(makes, "--touches 7")
    assert [name for name in unmet(report) if "p95" not in name] == []  # of seven it is the longest
    assert report["data"]["drop_cm"]["killed, no guardian"] > 20


def test_identification() -> None:
    report = reported(identification, "--arms 1 --seconds 20 --jobs 1")
    assert len(report["targets"]) == 7
    assert report["data"]["half_gap_mrad"]["unanswered"] == [0.0] * 7


def test_masses(monkeypatch: pytest.MonkeyPatch) -> None:
    """A small run; the result is tried in tests/identification/test_masses.py."""

    def examine(job: MassesJob) -> MassesFound:
        by = np.full((job.arms, 7), 1.1 if job.reaching.way == "ramps" else 1.3)
        loads = np.tile([0.4, 0.404, 0.002, 0.01, 0.01], (job.arms, 1))
        return MassesFound(job, 3.0 * by, by, loads, [])

    monkeypatch.setattr(masses, "examine", examine)
    assert unmet(reported(masses, "--arms 2 --jobs 1")) == [
        "rms of |r| over that by exact masses, held out, worst joint of the worst arm, by drives "
        "that do not ramp"
    ]


def test_oracle(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(oracle, "HANDS", {DESK_ARM: oracle.HANDS[DESK_ARM]})
    before, after = tmp_path / "before", tmp_path / "after"

    def same(*words: object) -> tuple[int, str]:
        result = CliRunner().invoke(oracle.main, list(map(str, words)), catch_exceptions=False)
        return result.exit_code, result.output.splitlines()[-1].strip()

    assert same(before)[0] == 0
    assert same(after, "--against", before) == (0, "identical")
    file = before / f"{DESK_ARM.name}.jsonl"
    lines = file.read_bytes().replace(b'"mode":"faulted"', b'"mode":"holding"')
    file.write_bytes(lines)
    status, words = same(after, "--against", before)
    assert status == 1
    assert words.startswith("differs at line 14")
    assert words.endswith(": mode")


def test_logs(monkeypatch: pytest.MonkeyPatch) -> None:
    """One log that is answered, and one that lacks what friction needs."""
    monkeypatch.setattr(logs, "SECONDS", 45.0)
    monkeypatch.setattr(logs, "STEPS", ("friction", "thresholds"))
    report = reported(logs, "--logs 5 --jobs 1")
    assert [name for name in unmet(report) if not name.startswith("gap")] == []
    assert [row["lacks"] for row in report["data"]["logs"]] == ["", "", "", "", "no torque"]
