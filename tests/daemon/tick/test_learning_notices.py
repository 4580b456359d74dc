"""News of what an arm learns of its friction, in lockstep."""

from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import ROMEO, lockstep_rig
from bench.study.world import load_known
from daemon.config.load import load_robot
from daemon.modes.table import Event
from daemon.tick.learning_notices import LOOKS_TICKS, LearningNotices
from simulator.gear_settings import GearSettings

LOSSY = GearSettings(load_driving=0.3, load_driven=0.24)


@pytest.mark.parametrize(
    ("gears", "known", "times"),
    [(GearSettings(), None, 0), (LOSSY, None, 1), (LOSSY, 0.02, 0)],
    ids=["sound", "lossy", "identified"],
)
def test_load_friction_that_was_not_identified_is_reported_once(
    gears: GearSettings, known: float | None, times: int
) -> None:
    joints = load_robot(ROMEO).configuration.joints
    if known is not None:
        joints = load_known(load_robot(ROMEO), gears, known).configuration.joints
    with lockstep_rig(
        configure=lambda c: msgspec.structs.replace(c, joints=joints),
        simulate=lambda s: msgspec.structs.replace(s, gears=gears),
    ) as rig:
        rig.enable()
        rig.request(Event.START)
        texts = [notice.text for state in rig.states(12.0) for notice in state.notices]
        load = rig.tick.learning_notices.load
    assert len([text for text in texts if "identify friction" in text]) == times
    assert ("LShoulderPitch" in load) == bool(times)


def notices(load: np.ndarray, met: np.ndarray) -> LearningNotices:
    estimator: Any = SimpleNamespace(
        learned=lambda: SimpleNamespace(load=load.copy()), given_up=np.zeros(1), met=met,
        transmission=SimpleNamespace(load_friction_error=np.zeros(1)), place=lambda i: 0.4,
    )  # fmt: skip
    return LearningNotices(estimator, ["a"])


@pytest.mark.parametrize(("led", "news"), [((), 1), (range(200), 0), (range(30), 0), ((170,), 1)])
def test_load_friction_learned_while_led_is_not_reported(led: range, news: int) -> None:
    """0.18 of it are learned within the first 100 ticks."""
    load, said = np.zeros(1), []
    found = notices(load, np.zeros(1, dtype=int))
    for tick in range(4 * LOOKS_TICKS):
        load[0] = 0.18 * min(tick / (2 * LOOKS_TICKS), 1.0)
        said += found.step(0.01 * tick, led=tick in led)
    assert len(said) == news
    assert bool(found.load) == bool(news)


@pytest.mark.parametrize(
    ("contacts_s", "led", "news"),
    [
        ((0.5, 1.0, 1.5, 2.0), lambda t: t < 4.0, 0),
        ((0.5, 1.0, 1.5, 2.0), lambda t: False, 0),
        ((0.5, 2.0, 3.5), lambda t: False, 1),
        ((0.5, 1.0, 1.5), lambda t: t % 0.5 > 0.1, 1),
    ],
    ids=["in one push", "bouncing", "apart", "yields thrice"],
)
def test_contacts_of_one_push_count_once(contacts_s, led, news: int) -> None:
    met, said = np.zeros(1, dtype=int), []
    found = notices(np.zeros(1), met)
    for tick in range(450):
        met[0] = sum(at <= 0.01 * tick for at in contacts_s)
        said += [notice.text for notice in found.step(0.01 * tick, led=led(0.01 * tick))]
    assert ["same place 3 times, near 0.40 rad" in text for text in said] == [True] * news
