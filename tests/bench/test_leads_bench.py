"""`bench.leads`: what counts as an end, and one lead of the simulated arm."""

from bench.leads import Lead, measure, targets_of
from daemon.modes.table import Mode


def test_what_does_not_track_again_counts() -> None:
    found = [
        Lead(Mode.TRACKING, "quiet for 2.00 s", 2.0, back=False),
        Lead(Mode.HOLDING, "the path would leave its limits", 2.0, back=False),
        Lead(Mode.RETURNING, "still under way", 30.0, back=True),
    ]
    (target,) = targets_of(found)
    assert (target.value, target.limit, target.met) == (2, 0, False)


def test_an_arm_that_was_led_goes_on_and_a_second_run_is_the_same() -> None:
    first, again = measure(1, seed=1), measure(1, seed=1)
    assert first == again
    assert [each.end for each in first] == [Mode.TRACKING]
    assert first[0].after_s >= 2.0
