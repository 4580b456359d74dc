"""Glossary, index and links of the pages: every name that the program shows is explained, once and
in order; the index has every page; every link leads somewhere."""

import re
from pathlib import Path
from typing import get_args

import pytest

from daemon.modes.table import Mode
from daemon.protocol.state import SideName
from docs.commands import pages

DOCS = Path(__file__).resolve().parents[2] / "docs"
ROWS = re.findall(r"^- (\*\*.+?\*\*): (.+)$", (DOCS / "glossary.md").read_text(), re.MULTILINE)
WORDS = [word for cell, _ in ROWS for word in re.findall(r"\*\*(.+?)\*\*", cell)]


@pytest.mark.parametrize("name", [*Mode, *get_args(SideName), "State", "Status"])
def test_a_name_that_the_program_shows_is_explained(name: str) -> None:
    assert name in WORDS


def test_every_word_is_explained_once_and_in_order() -> None:
    first = [re.findall(r"\*\*(.+?)\*\*", cell)[0].lower() for cell, _ in ROWS]
    assert first == sorted(first)
    assert len(set(WORDS)) == len(WORDS)


def test_a_word_that_the_glossary_leans_on_is_in_it() -> None:
    leant = {word for _, text in ROWS for word in re.findall(r"(?<!\*)\*([^*]+)\*(?!\*)", text)}
    known = {*WORDS, "link side", "sides", "stiction", "residual"}
    assert leant <= known


def test_concepts_use_the_glossarys_words() -> None:
    page = (DOCS / "concepts.md").read_text()
    said = {word.lower() for word in re.findall(r"(?<!\*)\*([\w\s-]+)\*(?!\*)", page)}
    other = {"play", "contact level", "collision level"}
    assert said - {word.lower() for word in WORDS} - other == set()


def test_the_index_has_every_page() -> None:
    index = (DOCS / "README.md").read_text()
    names = {page.name for page in DOCS.glob("*.md")} - {"README.md"}
    left_out = {name for name in names if f"]({name}" not in index}
    assert left_out == set(), "name them in docs/README.md"


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_every_link_leads_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"https?:", target):
            continue
        name, _, anchor = target.partition("#")
        there = (page.parent / name).resolve() if name else page
        if not there.exists() or (anchor and anchor not in anchors(there)):
            broken.append(target)
    assert broken == []


def anchors(page: Path) -> set[str]:
    """As the host of the pages makes them of headings."""
    titles = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
