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


LISTS = {
    "fields": "class State:\n    tick: int\n    mode: int\n    side: int\n",
    "keywords": "State(tick=1, mode=2)\n",
    "keys": "NAMES = {'side': 1, 'tick': 2}\n",
    "modules": "from steps import tick, mode\n",
    "reader": "print(state.tick, state.mode, 'side')\n",
}


def test_sources_that_list_a_field_are_counted_and_those_that_read_it_are_not() -> None:
    fields = HOUSE["fields_of"]("State", LISTS["fields"])
    assert fields == ["tick", "mode", "side"]
    assert HOUSE["files_that_list"](fields, LISTS.values()) == 4
    assert HOUSE["files_for_field"](fields, LISTS.values()) == 3  # of 4, 3 and 2


def test_a_walk_counts_the_stays_in_a_file_that_was_left() -> None:
    home = """
class Controller:
    def __init__(self, own: Own | None) -> None:
        self._own = own
    def step(self, observed: Input, dt: float) -> None:
        q, f = observed.q, dt
        f2(f)
        self._own.trigger(q)
        self._follow(observed)
    def _follow(self, seen: Input) -> None:
        f2(seen)
"""
    own, other = "class Own:\n    def trigger(self, q): ...\n", "def f2(x): ...\n"
    walk = HOUSE["Walk"]({"home": home, "own": own, "other": other}, "home")
    walk.enter("Controller", "step", {"observed"})
    assert walk.stays == ["home", "own", "home", "other"]
    assert walk.returns == 1


def test_what_is_imported_is_followed() -> None:
    texts = {
        "a/run.py": "from a import one\nfrom a.two import name\n",
        "a/one.py": "",
        "a/two.py": "def f():\n    from a.three import x\n",
        "a/three.py": "",
        "a/beside.py": "from a import run\n",
    }
    assert set(texts) - HOUSE["loaded_from"]("a/run.py", texts) == {"a/beside.py"}
