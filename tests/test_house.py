"""Limits of the house: what is counted, and that a measure beyond its limit fails."""

import runpy
from pathlib import Path

import pytest

HOUSE = runpy.run_path(str(Path(__file__).with_name("house.py")))


def test_sources_are_counted_by_lines(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "a.py").write_text("x = 1\ny = 2\n")
    (tmp_path / "one" / "a.pxd").write_text("z: int\n")
    (tmp_path / "one" / "a.so").write_text("no source\n")
    (tmp_path / "two").mkdir()
    (tmp_path / "two" / "b.py").write_text("x = 1\n")
    assert HOUSE["lines"](["one"], tmp_path) == 3


def test_only_calls_of_the_class_itself_are_constructors() -> None:
    text = "class State: ...\nState(1)\nServiceState(2)\nx: State\nf(State)\n[State() for _ in x]\n"
    assert HOUSE["constructors"]("State", text) == 2


@pytest.mark.parametrize(("now", "status"), [(3, 0), (4, 1)])
def test_beyond_its_limit_it_fails(
    now: int, status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    main, measure = HOUSE["main"], HOUSE["Measure"]("lines", now, 3, 1)
    monkeypatch.setitem(main.__globals__, "measures", lambda: [measure])
    assert main() == status
    assert ("BEYOND" in capsys.readouterr().out) == bool(status)


def test_long_files_are_named_and_made_ones_are_not_counted(tmp_path: Path) -> None:
    (tmp_path / "daemon").mkdir()
    lines = "x = 1\n" * 301
    (tmp_path / "daemon" / "long.py").write_text(lines)
    (tmp_path / "daemon" / "made.py").write_text(
        '"""Made from the code by `make reference`."""\n' + lines
    )
    assert HOUSE["long_files"](tmp_path) == ("daemon/long.py: 301 lines",)
