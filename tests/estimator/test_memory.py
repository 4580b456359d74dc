"""Memory of an estimator: written down and read back, it goes on bit-identically."""

import json

import numpy as np
import pytest

from errors import ModelError
from estimator.motor_position import Side
from estimator.settings import Variant

T = 0.01
BESIDE = (
    Variant(kind="classical", friction=False, rotor_inertia=False),
    Variant(kind="two_mass"),
    Variant(rotor_inertia=False),
)
AT_REVERSAL = 85
"""A tick of `pushed_motion` at which a joint is in its gap."""


@pytest.mark.parametrize("source", ["integrated", "measured"])
@pytest.mark.parametrize("at", [1, 2, 3, AT_REVERSAL, 850])
def test_memory_continues_bit_identically(make_estimator, pushed_motion, at, source) -> None:
    settings = {"beside": BESIDE, "motor_position": source, "debounce": 3}
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


def test_a_restored_estimator_still_holds_its_last_value(make_estimator, sine_motion) -> None:
    original, copy = make_estimator(), make_estimator()
    before = sine_motion.replay(original, slice(0, 200))[-1]
    copy.restore(original.memory())
    nothing = np.full(7, np.nan)
    held = copy.step(nothing, nothing, nothing, None, T)
    np.testing.assert_array_equal(held.residual, before.residual)
    np.testing.assert_array_equal(held.q, before.q)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda m: m.pop("residual"), "memory of an estimator"),
        (lambda m: m["residual"].pop("values"), "memory of residual"),
        (lambda m: m["residual"]["values"].pop(), "shape"),
        (lambda m: m["alignment"]["history"][0][0].__setitem__(0, float("nan")), "not within"),
        (lambda m: m["detector"]["raised"].__setitem__(0, "much"), "memory of detector"),
        (lambda m: m["alignment"]["count"].__setitem__(0, 2**62), "alignment.count: not within 0"),
        (lambda m: m["motor_position"]["sigma"].__setitem__(0, -0.1), "sigma: not within 0"),
        (lambda m: m["interval"]["begin"][0].__setitem__(0, 1e308), "interval.begin: not within"),
        (lambda m: m.__setitem__("residual", None), "memory of residual: NoneType"),
        (lambda m: m.__setitem__("kernel", 3.0), "memory of kernel: float"),
    ],
)
def test_damaged_memory_is_refused(make_estimator, damage, message: str) -> None:
    memory = make_estimator().memory()
    damage(memory)
    with pytest.raises(ModelError, match=message):
        make_estimator().restore(memory)
