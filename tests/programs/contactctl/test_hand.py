"""`contactctl hand`: words of a command line as the simulator gets them."""

from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from programs.contactctl import contactctl, hand


@pytest.fixture
def acts(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Commands to the hand."""
    reported: list[dict[str, Any]] = []

    def ask(_: Path, act: dict[str, Any]) -> str:
        reported.append(act)
        return "done"

    monkeypatch.setattr(hand, "ask_hand", ask)
    return reported


def typed(*words: str) -> Result:
    return CliRunner().invoke(contactctl.main, ["hand", "--hand-socket", "/none", *words])


@pytest.mark.parametrize("dashes", [[], ["--"]])
@pytest.mark.parametrize(
    ("words", "key", "value"),
    [
        (("push", "elbow", "-3Nm"), "torque", -3.0),
        (("lean", "elbow", "-0.5"), "torque", -0.5),
        (("lead", "elbow", "-.8rad"), "to", {"elbow": -0.8}),
        (("press", "z", "-20N"), "force", [0.0, 0.0, -20.0]),
    ],
)
def test_a_negative_number_is_no_option(
    acts: list[dict[str, Any]], words: tuple[str, ...], dashes: list[str], key: str, value: object
) -> None:
    assert typed(words[0], *dashes, *words[1:]).exit_code == 0
    assert acts[0][key] == value


def test_options_stand_anywhere_and_unknown_ones_are_refused(acts: list[dict[str, Any]]) -> None:
    assert typed("push", "elbow", "-3Nm", "--seconds", "2").exit_code == 0
    assert typed("push", "--seconds", "2", "elbow", "-3Nm").exit_code == 0
    assert [(act["torque"], act["duration_s"]) for act in acts] == [(-3.0, 2.0)] * 2
    wrong = typed("push", "elbow", "-3Nm", "--secnds", "2")
    assert wrong.exit_code == 2
    assert "No such option '--secnds'. Did you mean '--seconds'?" in wrong.output
    assert typed("push", "elbow", "-3Nm", "--hand-socket", "/other").exit_code == 0
    assert typed("push", "-h").exit_code == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("carry", "-1kg"), "'-1kg' is out of range: 0 to 100 kg."),
        (("carry", "101"), "'101' is out of range: 0 to 100 kg."),
        (("push", "elbow", "501Nm"), "'501Nm' is out of range: -500 to 500 Nm."),
        (("lead", "elbow", "101rad"), "'101rad' is out of range: -100 to 100 rad."),
        (("lead", "elbow", "1rad", "--torque", "-1Nm"), "'-1Nm' is out of range: 0.001 to 500 Nm."),
        (("gap", "elbow", "--torque", "0"), "'0' is out of range: 0.001 to 500 Nm."),
        (
            ("poke",),
            "no command 'poke'; there are: push, lean, press, lead, gap, clamp, carry, release",
        ),
    ],
)
def test_errors_list_the_allowed_values(words: tuple[str, ...], said: str) -> None:
    result = typed(*words)
    assert result.exit_code == 2
    assert said in result.output


def test_a_misspelt_option_of_payload_is_not_taken_for_a_name() -> None:
    for words in (["--cmo"], ["0.3", "--cmo", "1", "2", "3"]):
        result = CliRunner().invoke(contactctl.main, ["payload", *words])
        assert result.exit_code == 2
        assert "No such option '--cmo'." in result.output
        assert "'--com'?" in result.output
