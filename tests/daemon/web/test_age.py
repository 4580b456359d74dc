"""Age of figures on the page: those that were held up on their way are never shown as live."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
RUN = """
import { AgeClock } from "./page/src/stream.js";
const clock = new AgeClock();
const ages = JSON.parse(process.argv[1]).map(([monotonic_s, arrived_ms, asked_ms]) => {
  if (monotonic_s !== null) clock.arrived(monotonic_s, arrived_ms);
  return clock.age_ms(asked_ms);
});
console.log(JSON.stringify(ages.map((age) => (Number.isFinite(age) ? age : null))));
"""


def ages(*arrivals: tuple[float | None, float, float]) -> list[float | None]:
    """Ages [ms] after each arrival: the daemon's clock [s], the browser's at arrival and when it is
    asked [ms]."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node here: the page's clock is not tried")
    done = subprocess.run(
        [node, "--input-type=module", "-e", RUN, json.dumps(arrivals)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: list[float | None] = json.loads(done.stdout)
    return found


def test_before_the_first_nothing_is_live() -> None:
    assert ages((None, 0.0, 50.0)) == [None]


def test_it_grows_while_nothing_comes() -> None:
    found = ages((500.0, 10_000.0, 10_000.0), (None, 0.0, 10_700.0), (None, 0.0, 12_000.0))
    assert found == pytest.approx([0.0, 700.0, 2000.0])


def test_what_comes_late_is_as_old_as_it_is_late() -> None:
    """A stream that stood still for 3 s, and then brings all that had waited at once."""
    found = ages(
        (500.0, 10_000.0, 10_000.0),
        (500.1, 13_000.0, 13_000.0),
        (501.0, 13_001.0, 13_001.0),
        (503.0, 13_002.0, 13_002.0),
    )
    assert found == pytest.approx([0.0, 2900.0, 2001.0, 2.0])


def test_the_clocks_need_not_agree() -> None:
    found = ages((9e5, 3.0, 3.0), (9e5 + 1.0, 1005.0, 1005.0), (9e5 + 2.0, 2001.0, 2001.0))
    assert found == pytest.approx([0.0, 2.0, 0.0], abs=1e-6)
