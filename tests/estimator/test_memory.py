"""Memory of an estimator: written down and read back, it goes on bit-identically."""

import json

import numpy as np
import pytest

from common.errors import ModelError
from estimator.estimate import Flag
from estimator.estimator import Estimator
from estimator.motor_position import Side
from estimator.settings import Variant
from estimator.thresholds import Thresholds

T = 0.01
CONTACT = np.array([0.8, 0.5, 0.4, 0.3, 0.2, 0.2, 0.2])
BESIDE = (
    Variant(kind="classical", friction=False, rotor_inertia=False),
    Variant(kind="two_mass"),
    Variant(rotor_inertia=False),
)
AT_REVERSAL = 85
"""A tick of `pushed_motion` at which a joint is in its gap."""


@pytest.mark.parametrize("learning", [False, True])
@pytest.mark.parametrize("source", ["integrated", "measured"])
@pytest.mark.parametrize("at", [1, 2, 3, AT_REVERSAL, 850])
def test_memory_continues_bit_identically(
    make_estimator, pushed_motion, at: int, source: str, learning: bool
) -> None:
    settings = {"beside": BESIDE, "motor_position": source, "debounce": 3, "learning": learning}
    original = make_estimator(**settings)
    estimates = pushed_motion.replay(original, slice(0, at))
    assert (Side.GAP in estimates[-1].side) == (at == AT_REVERSAL)
    copy = make_estimator(**settings)
    copy.restore(json.loads(json.dumps(original.memory())))
    rest = slice(at, at + 60)
    pairs = zip(pushed_motion.replay(original, rest), pushed_motion.replay(copy, rest), strict=True)
    for one, other in pairs:
        for name in ("q", "q_dot", "theta", "phi_sigma", "side", "residual", "threshold"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert one.contacts == other.contacts
        assert one.flags == other.flags
        for name, values in one.beside.items():
            np.testing.assert_array_equal(values, other.beside[name])
    assert original.memory() == copy.memory()


@pytest.mark.parametrize("learning", [False, True])
def test_a_restored_estimator_still_holds_its_last_value(
    make_estimator, pushed_motion, learning: bool
) -> None:
    like = make_estimator(learning=learning)
    grows = Thresholds(CONTACT, 6 * CONTACT, per_speed=np.array(0.1))
    parts = like.model, like.transmission, like.settings, grows, T
    original, copy = (Estimator(*parts) for _ in range(2))
    before = pushed_motion.replay(original, slice(0, 900))[-1]
    assert before.touched_link
    copy.restore(original.memory())
    nothing = np.full(7, np.nan)
    held = copy.step(nothing, nothing, nothing, None, T)
    for name in ("residual", "q", "threshold", "thresholded", "touched_link"):
        np.testing.assert_array_equal(getattr(held, name), getattr(before, name), name)
    of_copy, of_original = copy.detector.levels, original.detector.levels
    np.testing.assert_array_equal(of_copy.above, of_original.above)
    np.testing.assert_array_equal(of_copy.share, of_original.share)
    np.testing.assert_array_equal(of_copy.crossing, of_original.crossing)
    speed = np.linspace(0.0, 0.3, 7)
    np.testing.assert_array_equal(copy.levels_at(speed), original.levels_at(speed))


def test_restored_levels_are_in_force(make_estimator) -> None:
    estimator = make_estimator(learning=True)
    memory = estimator.memory()
    memory["learning"]["peak"] = [0.5] * 7
    memory["learning"]["squares_s"] = [0.0] * 7
    memory["learning"]["crossing_peak"] = [0.4] * 7
    memory["learning"]["reach"] = [1.1] * 7
    estimator.restore(memory)
    np.testing.assert_allclose(estimator.detector.levels.share, 1.6 * 0.5 * 1.1)
    np.testing.assert_allclose(estimator.detector.levels.crossing, 1.8 * 0.4)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda m: m.pop("residual"), "memory of an estimator"),
        (lambda m: m["residual"].pop("values"), "memory of residual"),
        (lambda m: m["residual"]["values"].pop(), "shape"),
        (lambda m: m["alignment"]["history"][0][0].__setitem__(0, float("nan")), "not within"),
        (lambda m: m["levels"]["raised"].__setitem__(0, "much"), "memory of levels.raised"),
        (lambda m: m["levels"]["friction"].__setitem__(0, -0.1), "levels.friction: not within 0"),
        (lambda m: m["levels"]["begin"].__setitem__(0, -0.1), "levels.begin: not within 0"),
        (lambda m: m["stiction"]["ends"][1][4].__setitem__(6, 1.1), "stiction.ends: not within -1"),
        (lambda m: m["stiction"]["ends"][1].pop(), "memory of stiction.ends"),
        (lambda m: m["learning"]["moved_s"].__setitem__(0, 0.0), "learning.moved_s: not within"),
        (lambda m: m["learning"]["squares_s"].__setitem__(0, -1.0), "squares_s: not within 0"),
        (lambda m: m["learning"]["peak"].__setitem__(0, -1.0), "learning.peak: not within 0"),
        (
            lambda m: m["learning"]["crossing_peak"].__setitem__(0, -1.0),
            "crossing_peak: not within",
        ),
        (lambda m: m["alignment"]["count"].__setitem__(0, 2**62), "alignment.count: not within 0"),
        (lambda m: m["motor_position"]["sigma"].__setitem__(0, -0.1), "sigma: not within 0"),
        (lambda m: m["interval"]["begin"][0].__setitem__(0, 1e308), "interval.begin: not within"),
        (lambda m: m["residual"]["values"].__setitem__(0, ["1"] * 7), "residual.values"),
        (lambda m: m["learning"]["settled"].__setitem__(0, "1"), "memory of learning.settled"),
        (lambda m: m["alignment"]["count"].__setitem__(0, 2.5), "memory of alignment.count"),
        (lambda m: m["doubt"]["way"].__setitem__(0, 1e308), "memory of doubt.way"),
        (lambda m: m["kernel"].__setitem__("going", [True] * 7), "memory of kernel.going"),
        (lambda m: m.__setitem__("residual", None), "memory of residual: NoneType"),
        (lambda m: m.__setitem__("kernel", 3.0), "memory of kernel: float"),
    ],
)
def test_damaged_memory_is_refused(make_estimator, damage, message: str) -> None:
    estimator = make_estimator(learning=True)
    before = estimator.memory()
    memory = estimator.memory()
    damage(memory)
    with pytest.raises(ModelError, match=message):
        estimator.restore(memory)
    assert estimator.memory() == before


@pytest.mark.parametrize("learns", [False, True])
def test_memory_with_and_without_learning_is_not_exchangeable(make_estimator, learns: bool) -> None:
    memory = make_estimator(learning=learns).memory()
    with pytest.raises(ModelError, match="memory of an estimator"):
        make_estimator(learning=not learns).restore(memory)


@pytest.mark.parametrize("source", ["integrated", "measured"])
def test_memory_of_every_tick_continues_bit_identically(
    make_estimator, pushed_motion, source: str
) -> None:
    """While it learns, with samples missing: also that of a tick in which a joint lands, a contact
    begins, a joint has no sample, or one starts anew."""
    rng = np.random.default_rng(11)
    came = rng.random((300, 7)) > 0.1
    came[100:110, 2] = came[220:227, 6] = False
    settings = {"beside": BESIDE, "motor_position": source, "debounce": 2, "learning": True}
    original, copy = make_estimator(**settings), make_estimator(**settings)
    flags, landed, before = Flag(0), 0, None
    for k in range(300):
        row = (pushed_motion.current, pushed_motion.q, pushed_motion.theta_dot, pushed_motion.theta)
        samples = [values[650 + k] for values in row]
        one = original.step(*samples, T, fresh=came[k])
        if before is not None:
            other = copy.step(*samples, T, fresh=came[k])
            for name in ("residual", "threshold", "thresholded", "level_share", "side", "sensing"):
                values = (getattr(e, name) for e in (one, other))
                np.testing.assert_array_equal(*values, f"{k} {name}")
            for name in ("contacts", "touched_link", "flags"):
                assert getattr(one, name) == getattr(other, name), k
            landed += np.any((before.side == Side.GAP) & (one.side != Side.GAP))
        memory = json.loads(json.dumps(original.memory()))
        copy = make_estimator(**settings) if k % 50 == 0 else copy
        copy.restore(memory)
        assert original.memory() == copy.memory() == memory
        for name in ("above", "share", "crossing"):
            levels = (getattr(e.detector.levels, name) for e in (original, copy))
            np.testing.assert_array_equal(*levels, f"{k} {name}")
        flags, before = flags | one.flags, one
    assert landed > 5
    assert Flag.RESTARTED | Flag.BRIDGED | Flag.RAISED in flags
