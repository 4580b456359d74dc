"""docs/troubleshooting.md: reached from every fault, and says only what the program says."""

import re
from pathlib import Path

import pytest

from contactd_client.paths import why_unreachable
from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding, advice_on
from daemon.faults.symptoms import PAGE, SECTION_OF, advice_of
from daemon.faults.table import TABLE

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / PAGE).read_text(encoding="utf-8")
SECTIONS = {
    title.lower().replace(",", "").replace(" ", "-"): text
    for title, text in re.findall(r"^## (.+?)\n(.+?)(?=^## |\Z)", TEXT, re.MULTILINE | re.DOTALL)
}
SOURCES = "\n".join(
    path.read_text(encoding="utf-8")
    for folder in ("contactd_client", "daemon", "drivers", "estimator")
    for path in sorted((ROOT / folder).rglob("*.py"))
)


HELP = (ROOT / "programs/web/built/troubleshooting.html").read_text(encoding="utf-8")


def said_as(text: str) -> list[str]:
    line = text.partition("*Said as*")[2].partition("\n\n")[0]
    return re.findall(r"`([^`]+)`", line)


@pytest.mark.parametrize("condition", list(Condition))
def test_a_faults_advice_leads_to_a_section_that_names_it(condition: Condition) -> None:
    anchor = SECTION_OF[condition]
    assert advice_of(condition) == f"{TABLE[condition].advice}; more: {PAGE}#{anchor}"
    assert str(condition) in said_as(SECTIONS[anchor])


def test_every_way_to_advice_leads_there() -> None:
    """Status, and the page's banner, which goes by the cause alone."""
    finding = Finding(Condition.APART, "LElbowRoll", "0.1 rad")
    assert f"more: {PAGE}#motor-and-link-apart" in finding.advice
    assert advice_on(str(finding)) == finding.advice


def test_the_page_of_the_pages_server_has_every_section_and_no_link_that_leads_nowhere() -> None:
    ids = set(re.findall(r'id="([^"]+)"', HELP))
    assert {*SECTION_OF.values(), *SECTIONS} <= ids
    linked = re.findall(r'href="([^"]+)"', HELP.partition("<main")[2])
    assert linked
    assert {link.removeprefix("#") for link in linked} <= ids


@pytest.mark.parametrize("anchor", SECTIONS)
def test_what_is_said_is_what_the_program_says(anchor: str) -> None:
    words = said_as(SECTIONS[anchor])
    assert words or "*Said as* nothing" in SECTIONS[anchor]
    assert [text for text in words if text not in SOURCES] == []


@pytest.mark.parametrize("error", [FileNotFoundError(), ConnectionRefusedError()])
def test_who_reaches_no_daemon_finds_what_was_said(error: OSError) -> None:
    said = why_unreachable(Path("/tmp/contactd-1.sock"), error)
    assert any(words in said for words in said_as(SECTIONS["it-does-not-start-or-refuses"]))


def test_signs_come_before_the_gap() -> None:
    text = SECTIONS["motor-and-link-apart"]
    assert text.index("**Signs") < text.index("**The encoder.") < text.index("**The gap.")
