"""`contactctl gain --balance` against the whole daemon: proposed, applied, refused."""

import json
from typing import Any

import pytest

from bench.rigs.lockstep import ROMEO
from bench.rigs.served_daemon import ServedDaemon, served_daemon


@pytest.fixture(scope="module")
def romeo(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with served_daemon(tmp_path_factory.mktemp("romeo"), ROMEO) as served:
        yield served


def gains(served: ServedDaemon) -> dict[str, float]:
    found = json.loads(served.contactctl("--json", "gain").stdout)
    assert isinstance(found, dict)
    return found


def test_a_proposal_changes_nothing_and_is_applied_as_proposed(
    romeo: ServedDaemon,
) -> None:
    before = gains(romeo)
    proposed = romeo.contactctl("gain", "--balance")
    assert proposed.exit_code == 0, proposed.output
    assert "nothing has changed: --apply" in proposed.stdout
    assert gains(romeo) == before
    assert "K_a in rad/s per Nm" in proposed.stdout
    shown = romeo.contactctl("gain", "LElbowRoll").stdout.split(maxsplit=2)
    assert shown == ["LElbowRoll", f"{before['LElbowRoll']:g}", "rad/s per Nm\n"]

    applied = romeo.contactctl("--json", "gain", "--balance", "--apply")
    assert applied.exit_code == 0, applied.output
    reply = json.loads(applied.stdout)
    assert reply["applied"] is True
    assert gains(romeo) == {name: row["gain"] for name, row in reply["joints"].items()}
    assert gains(romeo) != before


def test_the_table_shows_the_forces_before_and_after(romeo: ServedDaemon) -> None:
    rows = json.loads(romeo.contactctl("--json", "gain", "--balance").stdout)["joints"]
    least = {row["least_N"] for row in rows.values()}
    assert max(least) == pytest.approx(min(least), rel=0.01)
    table = romeo.contactctl("gain", "--balance").stdout
    assert all(name in table for name in rows)
    row = rows["LShoulderPitch"]
    for when in ("now_", ""):
        assert f" {row[f'{when}least_N']:.1f} to {row[f'{when}most_N']:.1f}" in table
    assert "inf" not in table  # the drives are off, so nothing is detected yet
    assert max(map(len, table.split("Forces")[0].splitlines())) <= 80
    assert "Ratio of largest to smallest force when led: " in table


def test_a_gain_that_is_refused_while_applying_is_an_error(
    romeo: ServedDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.tick.leading.MAX_GAIN", 0.0)
    result = romeo.contactctl("gain", "--balance", "--apply")
    assert result.exit_code == 1
    assert "is not a gain" in result.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("LElbowRoll", "--balance"), "--balance applies to all joints"),
        (("--apply",), "--apply requires --balance"),
        (("LElbowRoll", "0.3", "--apply"), "--apply requires --balance"),
    ],
)
def test_contradictory_options_are_refused(
    romeo: ServedDaemon, words: tuple[str, ...], said: str
) -> None:
    before = gains(romeo)
    result = romeo.contactctl("gain", *words)
    assert (result.exit_code, result.stdout) == (2, "")
    assert said in result.stderr
    assert gains(romeo) == before


def test_a_gain_just_beyond_its_bound_is_shown_as_it_is(romeo: ServedDaemon) -> None:
    result = romeo.contactctl("gain", "LElbowRoll", "5.0000001")
    assert result.exit_code == 1
    assert "5.0000001 is not a gain: 0, or 0.0001 to 5 rad/s per Nm" in result.stderr
