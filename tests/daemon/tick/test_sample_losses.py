"""Share of samples that go missing, and its news."""

import numpy as np
import pytest

from daemon.tick.sample_losses import SampleLosses

BOTH = np.array([True, True])
ELBOW_LOST = np.array([True, False])


def reported(losses: SampleLosses, lost_of_ten: int, ticks: int) -> list[str]:
    news = []
    for k in range(ticks):
        lost = k % 10 < lost_of_ten
        news += losses.step(ELBOW_LOST if lost else BOTH, complete=not lost)
    return [notice.text for notice in news]


def test_a_joint_with_many_lost_samples_is_reported_once_by_name() -> None:
    losses = SampleLosses(["shoulder", "elbow"], 0.01)
    (text,) = reported(losses, 4, 5000)
    assert text.startswith("samples go missing: elbow 10%: cable")
    assert losses.share == pytest.approx([0.0, 0.4], abs=0.01)
    # Over, and again.
    assert reported(losses, 0, 10_000) == []
    assert losses.share[1] < 1e-3
    assert len(reported(losses, 4, 5000)) == 1


def test_few_lost_samples_are_not_reported() -> None:
    losses = SampleLosses(["shoulder", "elbow"], 0.01)
    assert reported(losses, 0, 10) == []
    assert losses.share.tolist() == [0.0, 0.0]
    for _ in range(50):
        assert reported(losses, 1, 10) + reported(losses, 0, 40) == []
    assert losses.share[1] == pytest.approx(0.01, abs=0.015)
    assert losses.share[1] > 0.0


def test_answers_that_are_late_again_and_again_are_reported_once() -> None:
    losses = SampleLosses(["shoulder", "elbow"], 0.01)

    def late(every: int, ticks: int) -> list[str]:
        news = [losses.step(BOTH, complete=bool(k % every)) for k in range(ticks)]
        return [notice.text for some in news for notice in some]

    (text,) = late(2, 5000)
    assert text.startswith("answers come later than usual in 10% of ticks")
    assert losses.share.tolist() == [0.0, 0.0]
    assert late(100, 10_000) == []
    assert len(late(2, 5000)) == 1
