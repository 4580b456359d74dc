"""Reference pages against the code that they are made from."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

from daemon.config.schema import Configuration, JointLimits
from daemon.faults.conditions import Condition
from daemon.modes.table import TRANSITIONS

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture(scope="module")
def reference() -> ModuleType:
    spec = importlib.util.spec_from_file_location("reference", DOCS / "reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_what_is_made_is_current(reference: ModuleType) -> None:
    made = reference.files()
    assert {path.name for path in made} >= {"faults.md", "state.json", "messages.py"}
    for path, text in made.items():
        said = f"{path} is not what the code says: run `make reference`"
        assert path.read_text(encoding="utf-8") == text, said


def test_every_condition_and_every_transition_can_be_read_back() -> None:
    faults, modes = ((DOCS / page).read_text() for page in ("faults.md", "modes.md"))
    assert re.findall(r"^### (.+)$", faults, re.MULTILINE) == list(Condition)
    rows = re.findall(r"^ +(\w+) --> (\w+) : (.+)$", modes, re.MULTILINE)
    same = modes.partition("## What changes nothing\n")[2].partition("\n## ")[0]
    rows += [(m, m, events) for m, events in re.findall(r"^\| `(\w+)` \| (.+) \|$", same, re.M)]
    shown = [
        (before, event.strip("`"), after)
        for before, after, events in rows
        for event in events.split(", ")
    ]
    assert sorted(shown) == sorted((*row, after) for row, after in TRANSITIONS.items())


def test_a_part_is_written_between_its_markers_and_nothing_else_is(reference: ModuleType) -> None:
    page = "by hand\n<!-- a: made by `make reference` -->\nold\n<!-- end -->\nby hand, too\n"
    made = reference.filled(page, {"a": "new"})
    assert made == page.replace("old", "\nnew\n")
    assert reference.filled(made, {"a": "new"}) == made


@pytest.mark.parametrize("parts", [(), ("b",), ("a", "b")])
def test_markers_that_are_not_those_of_the_parts_are_refused(
    reference: ModuleType, parts: tuple[str, ...]
) -> None:
    with pytest.raises(ValueError, match="has the parts"):
        reference.filled(
            "<!-- a: made by `make reference` -->\n<!-- end -->\n", dict.fromkeys(parts, "")
        )


def test_every_key_and_every_link_is_there(reference: ModuleType) -> None:
    page = reference.configuration_page()
    titles = {title.lower() for title in re.findall(r"^## (\w+)", page, re.MULTILINE)}
    assert set(re.findall(r"\]\(#(\w+)\)", page)) <= titles
    section = page.partition("## JointLimits\n")[2].partition("\n## ")[0]
    assert re.findall(r"^\| \**`(\w+)`", section, re.MULTILINE) == list(
        JointLimits.__struct_fields__
    )
    assert "| **`velocity`** | number (0, 20] rad/s |  |" in section
    first = page.partition("## The file\n")[2].partition("\n## ")[0]
    assert re.findall(r"^\| \**`(\w+)`", first, re.MULTILINE) == list(
        Configuration.__struct_fields__
    )
