"""Benches run small: the command itself, from its options to its targets."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from bench import commissioning, identification, masses, mutants, oracle, reaction, requests, web
from bench.report import Target
from bench.rigs.faults import PLACES, SHOWN
from bench.rigs.lockstep import DESK_ARM, SINGLE_JOINT
from bench.study.masses import MassesFound, MassesJob


def reported(command: Any, *words: str) -> dict[str, Any]:
    result = CliRunner().invoke(command, [*words, "--json"], catch_exceptions=False)
    found: dict[str, Any] = json.loads(result.stdout.splitlines()[-1])
    return found


def unmet(report: dict[str, Any]) -> list[str]:
    return [target["name"] for target in report["targets"] if not target["met"]]


def test_reaction(monkeypatch: pytest.MonkeyPatch) -> None:
    few = {"drive restarts", "one late tick", "8 late ticks"}
    shown = tuple(s for s in SHOWN if s.place == PLACES[0] and s.case.name in few)
    monkeypatch.setattr(reaction, "PLACES", PLACES[:1])
    monkeypatch.setattr(reaction, "SHOWN", shown)
    report = reported(reaction.main)
    faults = {row["fault"] for row in report["data"]["rows"]}
    assert faults == few | {"exception in the tick", "daemon killed"}
    assert unmet(report) == []


def test_reaction_to_pairs() -> None:
    report = reported(reaction.main, "--part", "pairs", "--sample", "1")
    assert len(report["data"]["rows"]) == 1
    assert unmet(report) == []


def test_identification() -> None:
    report = reported(identification.main, "--arms", "1", "--seconds", "20", "--jobs", "1")
    assert len(report["targets"]) == 7
    assert report["data"]["half_gap_mrad"]["unanswered"] == [0.0] * 7


def test_masses(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is found of an arm is tried in tests/identification/test_masses.py."""

    def examine(job: MassesJob) -> MassesFound:
        by = np.full((job.arms, 7), 1.1 if job.reaching.way == "ramps" else 1.3)
        loads = np.tile([0.4, 0.404, 0.002, 0.01, 0.01], (job.arms, 1))
        return MassesFound(job, 3.0 * by, by, loads, [])

    monkeypatch.setattr(masses, "examine", examine)
    assert unmet(reported(masses.main, "--arms", "2", "--jobs", "1")) == [
        "rms of |r| over that by exact masses, held out, worst joint of the worst arm, by drives "
        "that do not ramp"
    ]


def test_commissioning(monkeypatch: pytest.MonkeyPatch) -> None:
    """An arm goes from zero to armed in tests/docs/test_first_arm.py."""
    seen: list[tuple[str, int]] = []

    def part(name: str, limit: float) -> Any:
        def commission(folder: Path, seed: int, show: Any) -> tuple[list[Target], dict[str, Any]]:
            assert folder.is_dir()
            seen.append((name, seed))
            return [Target(name, 1.0, limit)], {}

        return commission

    parts = {"romeo": part("romeo", 2.0), "upright": part("upright", 0.5)}
    monkeypatch.setattr(commissioning, "PARTS", parts)
    assert unmet(reported(commissioning.main, "--seed", "3")) == ["upright"]
    assert unmet(reported(commissioning.main, "--part", "romeo")) == []
    assert seen == [("romeo", 3), ("upright", 3), ("romeo", 1)]


def test_requests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requests, "ROBOTS", (SINGLE_JOINT,))
    report = reported(requests.main, "--seconds", "1")
    (arm,) = report["data"]["arms"]
    assert arm["requests"] > 0
    assert (arm["missed"], arm["broken"], arm["ended"]) == ([], [], "")


def test_web_without_a_browser(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web, "chromium", lambda: None)
    report = reported(web.main, "--rounds", "1", "--seconds", "1")
    values = {target["name"]: target["value"] for target in report["targets"]}
    assert report["data"]["states_read"] > 0
    assert values["memory of the web process"] > 10.0
    assert "first paint" not in values


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


def test_mutants_are_of_files_that_there_are() -> None:
    for file, tests in mutants.TESTS.items():
        assert all((mutants.ROOT / each).is_file() for each in (file, *tests))
    listed = mutants.equivalent(tuple(mutants.TESTS))
    assert {mutant.file for mutant in listed} <= set(mutants.TESTS)
