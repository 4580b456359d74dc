"""Points of the checklist of a release, as far as they are decided without building."""

from pathlib import Path

import pytest

from package import release
from version import released

CUT = """# Changelog

## [Unreleased]

## [0.2.0] - 2026-12-01

- more

## [0.1.0] - 2026-11-23
"""


@pytest.mark.parametrize("text", ["", "0.2", "v0.2.0", "0.2.0rc1", "0.2.0\n"])
def test_what_is_no_version_is_refused(text: str) -> None:
    assert release.a_version(text)
    assert not release.a_version("0.2.0")


@pytest.mark.parametrize(
    ("text", "right"),
    [
        (CUT, True),
        (CUT.replace("[Unreleased]\n", "[Unreleased]\n\n- forgotten\n"), False),
        (CUT.replace("## [Unreleased]\n\n", ""), False),
        (CUT.replace("0.2.0] - 2026-12-01", "0.2.0]"), False),
        (CUT.replace("0.2.0", "0.3.0"), False),
        ("", False),
    ],
)
def test_the_changelog_names_the_release_and_its_day(
    tmp_path: Path, text: str, right: bool
) -> None:
    (tmp_path / "CHANGELOG.md").write_text(text)
    assert (release.the_changelog_is_cut("0.2.0", tmp_path) == "") is right


def test_the_clients_number_is_that_of_the_latest_release() -> None:
    assert not release.the_client_has_its_number(released(release.ROOT))
    assert "contactd_client is" in release.the_client_has_its_number("9.9.9")


def test_all_quick_points_are_reported_and_nothing_long_begins(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def begun(_: str) -> str:
        raise AssertionError("long")

    monkeypatch.setattr(release, "LONG", (begun,))
    assert release.main("") == 1
    said = capsys.readouterr().out
    assert "NO  a version" in said
    assert "NO  the changelog is cut" in said
    assert "NO  the client has its number" in said
