"""Residuals: closed form of the first-order filter, linearity, refusals, the variants' meaning."""

from typing import get_args

import msgspec
import numpy as np
import pytest

from errors import ModelError
from estimator.residual import Kind, Residual, Variant, forms

K, T = 25.0, 0.01
BACKLASH = (Variant(),)
ENGAGED = np.ones(2)


def errors(always: object = 0.0, engaged: object = 0.0) -> np.ndarray:
    """e(k) [Nm s] of one variant: the part that always acts, and that while engaged."""
    return np.stack([np.broadcast_to(always, 2), np.broadcast_to(engaged, 2)]).astype(float)


def test_step_response_is_tustins_first_order_filter() -> None:
    # Constant external torque: the momentum grows by tau T each tick. The pole of (13), and the
    # continuous filter within its discretisation error.
    residual = Residual(BACKLASH, K, T, 2)
    tau = np.array([1.0, -3.0])
    pole = (2 - T * K) / (2 + T * K)
    for k in range(1, 60):
        r = residual.step(errors(tau * T), ENGAGED, np.full(2, T))[0]
        np.testing.assert_allclose(r, tau * (1 - pole**k), rtol=1e-12)
        np.testing.assert_allclose(r, tau * (1 - np.exp(-K * k * T)), atol=0.01 * 3)


def test_half_of_a_step_after_ln2_over_gain() -> None:
    residual = Residual(BACKLASH, K, 0.001, 2)
    k = 0
    while residual.values[0, 0] < 0.5:
        residual.step(errors(0.001), ENGAGED, np.full(2, 0.001))
        k += 1
    assert k * 0.001 == pytest.approx(np.log(2) / K, abs=0.001)


def test_true_intervals_give_the_same_end() -> None:
    # One missed tick: the momentum of both intervals arrives at once, over twice the time.
    even, uneven = Residual(BACKLASH, K, T, 2), Residual(BACKLASH, K, T, 2)
    for _ in range(4):
        even.step(errors(T), ENGAGED, np.full(2, T))
    for dt in (T, 2 * T, T):
        uneven.step(errors(dt), ENGAGED, np.full(2, dt))
    assert uneven.values[0, 0] == pytest.approx(even.values[0, 0], abs=0.01)
    assert uneven.values[0, 0] != even.values[0, 0]


def test_linear_in_what_acts() -> None:
    rng = np.random.default_rng(5)
    series = rng.normal(size=(2, 40, 6, 2))
    kinds = [Variant(kind=k, label=k) for k in ("classical", "backlash", "two_mass")]
    first, second, both = (Residual(kinds, K, T, 2) for _ in range(3))
    for a, b in zip(*series, strict=True):
        first.step(a, ENGAGED, np.full(2, T))
        second.step(b, ENGAGED, np.full(2, T))
        both.step(2 * a - b, ENGAGED, np.full(2, T))
    np.testing.assert_allclose(both.values, 2 * first.values - second.values, atol=1e-12)


def test_what_acts_while_engaged_is_left_out_in_the_gap() -> None:
    residual = Residual(BACKLASH, K, T, 2)
    r = residual.step(errors(T, 2 * T), np.array([1.0, 0.0]), np.full(2, T))[0]
    np.testing.assert_allclose(r, np.array([3.0, 1.0]) * 2 * K * T / (2 + T * K))


def test_an_interval_beyond_the_pole_is_its_mean() -> None:
    residual = Residual(BACKLASH, K, T, 2)
    residual.values[:] = 7.0
    residual.step(errors(0.3), ENGAGED, np.full(2, 0.1))
    np.testing.assert_allclose(residual.values, 3.0)


ALWAYS = "+momentum -beta"
TOGETHER = "+motor_friction +engaged_link_friction +stiction"
APART = "+link_friction +gap_friction"


@pytest.mark.parametrize(
    ("variant", "engaged", "apart"),
    [
        (Variant(kind="classical", friction=False, rotor_inertia=False), "-tau_M", "-tau_M"),
        (Variant(kind="classical", rotor_inertia=False), f"-tau_M {TOGETHER}", None),
        (Variant(kind="classical"), f"-tau_M +rotor {TOGETHER}", None),
        (Variant(), f"-tau_M +rotor {TOGETHER}", APART),
        (Variant(rotor_inertia=False), f"-tau_M {TOGETHER}", APART),
        (Variant(friction=False), "-tau_M +rotor", ""),
        (Variant(kind="two_mass"), "-tau_M +rotor +motor_friction +link_friction +stiction", None),
        (Variant(kind="two_mass", friction=False), "-tau_M +rotor", None),
    ],
)
def test_what_each_variant_believes(variant: Variant, engaged: str, apart: str | None) -> None:
    def signs(words: str) -> dict[str, float]:
        return {word[1:]: float(word[0] + "1") for word in f"{ALWAYS} {words}".split()}

    always, while_engaged = forms(variant)
    together = {
        name: always.get(name, 0.0) + while_engaged.get(name, 0.0)
        for name in {**always, **while_engaged}
    }
    assert {name: weight for name, weight in together.items() if weight} == signs(engaged)
    assert dict(always) == signs(engaged if apart is None else apart)


def test_names() -> None:
    switches = [(False, False), (False, True), (True, False), (True, True)]
    names = [
        Variant(kind=kind, friction=friction, rotor_inertia=rotor).name
        for kind in ("classical", "backlash")
        for friction, rotor in switches
    ]
    assert names == [
        *("classical", "classical+rotor", "classical+friction", "classical+friction+rotor"),
        *("backlash-friction-rotor", "backlash-friction", "backlash-rotor", "backlash"),
    ]
    assert Variant(label="mine").name == "mine"


@pytest.mark.parametrize(("gain", "period"), [(200.0, 0.01), (25.0, 0.08), (0.0, 0.01)])
def test_a_gain_that_rings_is_refused(gain: float, period: float) -> None:
    with pytest.raises(ModelError, match="gain"):
        Residual(BACKLASH, gain, period, 1)
    Residual(BACKLASH, 199.0, 0.01, 1)


def test_variants_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ModelError, match="different names"):
        Residual([Variant(), Variant()], K, T, 1)
    with pytest.raises(ModelError, match="two_mass"):
        Residual([Variant(kind="two_mass", rotor_inertia=False)], K, T, 1)
    with pytest.raises(msgspec.ValidationError, match="unknown field"):
        msgspec.convert({"kind": "backlash", "gain": 3}, Variant)


def test_every_kind_can_be_built() -> None:
    for kind in get_args(Kind):
        always, engaged = forms(Variant(kind=kind))
        assert always.keys() | engaged.keys() > {"momentum", "beta", "tau_M"}
