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
const ages = [];
for (const [what, ...times] of JSON.parse(process.argv[1])) {
  if (what === "age") ages.push(clock.age_ms(...times));
  else clock[what](...times);
}
console.log(JSON.stringify(ages.map((age) => (Number.isFinite(age) ? age : null))));
"""
Step = tuple[str | float, ...]


def ages(*steps: Step) -> list[float | None]:
    """Ages [ms] that a clock gives: calls of its methods in order, each a name and times: those of
    the daemon's clock in s, of the browser's in ms."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node here: the page's clock is not tried")
    done = subprocess.run(
        [node, "--input-type=module", "-e", RUN, json.dumps(steps)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: list[float | None] = json.loads(done.stdout)
    return found


def test_nothing_is_live_before_figures_and_clock() -> None:
    assert ages(("age", 50.0)) == [None]
    assert ages(("arrived", 500.0), ("age", 50.0)) == [None]
    assert ages(("read", 500.0, 10.0), ("age", 50.0)) == [None]
    assert ages(("read", 500.0, 10.0), ("arrived", 500.0), ("reset",), ("age", 20.0)) == [None]


def test_the_age_grows_while_nothing_comes() -> None:
    steps = [("read", 500.0, 10_000.0), ("arrived", 500.0)]
    asked = [("age", at_ms) for at_ms in (10_000.0, 10_700.0, 12_000.0)]
    assert ages(*steps, *asked) == pytest.approx([0.0, 700.0, 2000.0])


def test_the_age_of_late_figures_is_their_delay() -> None:
    """A stream that stood still for 3 s, and then brings all that had waited at once."""
    late = [(500.1, 13_000.0), (501.0, 13_001.0), (503.0, 13_002.0)]
    steps = [step for then_s, now_ms in late for step in (("arrived", then_s), ("age", now_ms))]
    assert ages(("read", 500.0, 10_000.0), *steps) == pytest.approx([2900.0, 2001.0, 2.0])


def test_a_stream_that_is_late_from_the_first_is_old() -> None:
    """A link too slow for it: every figure comes 5 s late, and none sooner."""
    steps = [("read", 505.0, 15_000.0)]
    for second in range(5):
        steps += [("arrived", 500.0 + second), ("age", 15_000.0 + 1e3 * second)]
    assert ages(*steps) == pytest.approx([5000.0] * 5)


def test_a_slow_answer_of_the_clock_lowers_no_age() -> None:
    """The question waits 400 ms before the clock is read; a later one does not."""
    steps = [("read", 500.4, 10_000.0), ("arrived", 500.3), ("age", 10_300.0)]
    assert ages(*steps, ("read", 500.3, 10_300.0), ("age", 10_300.0)) == pytest.approx([400.0, 0.0])


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_clocks_that_drift_apart_are_followed(drift: float) -> None:
    """By 9 s in a day, while the clock is asked for every 3 s."""
    rate = 1e3 * (1.0 + drift)
    steps: list[Step] = [("read", 3.0 * i, rate * 3.0 * i) for i in range(28_800)]
    found = ages(*steps[::100], *steps[-30:], ("arrived", 86_400.0), ("age", rate * 86_400.0))
    assert found == pytest.approx([0.0], abs=10.0)


def test_figures_from_the_future_are_not_live() -> None:
    """Our clock slept for an hour with the lid closed."""
    steps = [("read", 500.0, 10_000.0), ("arrived", 500.0), ("age", 10_000.0)]
    found = ages(*steps, ("arrived", 4100.0), ("age", 10_001.0))
    assert found == [pytest.approx(0.0), None]
