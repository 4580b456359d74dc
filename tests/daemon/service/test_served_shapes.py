"""Shapes of an arm behind its socket: a payload's box among them, and why none is guarded."""

from collections.abc import Iterator
from pathlib import Path
from shutil import copytree

import pytest
from click.testing import CliRunner

from bench.rigs.lockstep import DESK_ARM
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from programs.clients.client import Client
from programs.contactd.contactd import main

TABLE = "version: 1\nplanes:\n  table: {point: [0, 0, -2], normal: [0, 0, 1]}\n"


@pytest.fixture
def shaped(tmp_path: Path) -> Path:
    folder = Path(copytree(DESK_ARM, tmp_path / "arm"))
    (folder / "surroundings.yaml").write_text(TABLE)
    run = CliRunner().invoke(main, ["shapes", str(folder), "--single"], catch_exceptions=False)
    assert run.exit_code == 0
    return folder


@pytest.fixture
def served(shaped: Path, tmp_path: Path) -> Iterator[ServedDaemon]:
    with served_daemon(tmp_path, shaped) as opened:
        opened.run(0.1)
        yield opened


def guarded(served: ServedDaemon) -> set[frozenset[str]]:
    walls = served.rig.tick.controller.motion.walls
    assert walls is not None
    return {frozenset(one.name for one in pair) for pair in walls.clearance.pairs}


def test_the_box_of_a_payload_is_guarded_while_it_is_announced(served: ServedDaemon) -> None:
    box, table = ["--box", "0.1", "0.05", "0.2"], frozenset(("payload", "table"))
    assert table not in guarded(served)
    result = served.contactctl("payload", "0.3", "--com", "0", "0", "0.2", *box)
    assert (result.exit_code, "0.1 x 0.05 x 0.2 m" in result.stdout) == (0, True)
    served.run(0.05)
    state = served.rig.state()
    assert state.payload is not None
    assert state.payload.box == [0.1, 0.05, 0.2]
    assert table in guarded(served)
    assert not any("shape" in notice.text for notice in state.notices)
    for without in (["0.3"], ["none"]):
        assert served.contactctl("payload", "0.3", *box).exit_code == 0
        assert table in guarded(served)
        assert served.contactctl("payload", *without).exit_code == 0
        assert table not in guarded(served)


def test_more_than_a_tick_has_time_for_is_refused(served: ServedDaemon, shaped: Path) -> None:
    planes = [f"  p{k}: {{point: [0, 0, -{k + 2}], normal: [0, 0, 1]}}\n" for k in range(75)]
    (shaped / "surroundings.yaml").write_text("version: 1\nplanes:\n" + "".join(planes))
    (folder := shaped.parent / "full").mkdir()
    with served_daemon(folder, shaped) as full:
        full.run(0.1)
        result = full.contactctl("payload", "0.3", "--box", "0.1", "0.1", "0.1")
        assert result.exit_code == 1
        assert "at most 150" in result.stderr
        assert full.rig.tick.payload is None


def test_an_unguarded_arm_has_a_reason(served: ServedDaemon, shaped: Path, client: Client) -> None:
    assert served.until(client.ask_status).unguarded == ""
    (shaped / "identified.yaml").unlink()
    config = shaped / "config.yaml"
    config.write_text("\n".join(x for x in config.read_text().split("\n") if "known:" not in x))
    (blind := shaped.parent / "blind").mkdir()
    with served_daemon(blind, shaped) as other:
        other.run(0.1)
        assert other.rig.tick.controller.motion.walls is None
        status = other.contactctl("status").stdout
        assert "no shape is guarded" in status
        box = ["--com", "0", "0", "0.2", "--box", "0.1", "0.05", "0.2"]
        assert other.contactctl("payload", "0.3", *box).exit_code == 0
        assert other.rig.tick.controller.motion.walls is None
