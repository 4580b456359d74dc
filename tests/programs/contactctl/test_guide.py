"""`contactctl guide` against the whole daemon: shown, changed, read back, refused."""

import json
from typing import Any

import pytest

from bench.rigs.lockstep import BEAM
from bench.rigs.served_daemon import ServedDaemon, served_daemon


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """An arm of six joints."""
    with served_daemon(tmp_path_factory.mktemp("beam"), BEAM) as served:
        yield served


def shown(served: ServedDaemon) -> dict[str, Any]:
    found = json.loads(served.contactctl("--json", "guide").stdout)
    assert isinstance(found, dict)
    return found


@pytest.mark.parametrize(
    ("words", "axes"),
    [
        ("line x", {"stiff": ["y", "z"]}),
        ("plane xy --no-turn", {"stiff": ["z", "rx", "ry", "rz"]}),
        ("point --frame base", {"frame": "base", "stiff": ["x", "y", "z"]}),
        ("--damped x,rz --held y", {"held": ["y"], "damped": ["x", "rz"]}),
        ("--joints-held", {"redundant": "held"}),
        ("off", {}),
    ],
)
def test_a_guide_is_changed_and_read_back(
    beam: ServedDaemon, words: str, axes: dict[str, Any]
) -> None:
    result = beam.contactctl("guide", *words.split())
    assert result.exit_code == 0, result.output
    assert shown(beam) == axes
    said = result.stdout.removeprefix("guide: ")
    assert beam.contactctl("guide").stdout == f"guide: {said}"
    assert ("off" in said) == (not axes)
    status = beam.contactctl("status").stdout
    assert ("\nguide" in status) == bool(axes)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ("circle", 2, "'line', 'plane', 'point', 'off'"),
        ("line", 2, "a line runs along one of x, y, z, not none"),
        ("line xy", 2, "a line runs along one of x, y, z, not xy"),
        ("line x --stiff x", 2, "the line runs along x, which cannot be held"),
        ("plane xy --held y", 2, "the plane runs along y, which cannot be held"),
        ("plane xx", 2, "a plane has two of x, y, z, not xx"),
        ("point x", 2, "a point takes no axes, not x"),
        ("off x", 2, "Error: off takes no axes, not x"),
        ("--stiff q", 2, "'q' is not made of x, y, z, rx, ry, rz"),
        ("--frame base", 2, "--frame requires a guide"),
        ("off --no-turn", 2, "off takes no options"),
        ("line x --frame palm", 1, "moves no link 'palm'"),
        ("point --frame \udcff", 2, r"'\udcff' is not utf-8 text"),
        ("line x --damped y", 1, "y named twice"),
        ("point --no-turn", 1, "6 directions held leave an arm of 6 joints none to move in"),
    ],
)
def test_a_wrong_guide_is_refused_and_changes_nothing(
    beam: ServedDaemon, words: str, code: int, said: str
) -> None:
    assert beam.contactctl("guide", "line", "z").exit_code == 0
    result = beam.contactctl("guide", *words.split())
    assert result.exit_code == code, result.output
    assert said in " ".join(result.stderr.split())
    assert shown(beam) == {"stiff": ["x", "y"]}
