"""Residuals: closed form of the first-order filter, linearity, refusals, the variants' meaning."""

from typing import get_args

import msgspec
import numpy as np
import pytest

from common.errors import ModelError
from estimator.interval import ROW
from estimator.residual import Residual, forms
from estimator.settings import Kind, Variant

K, T = 25.0, 0.01
BACKLASH = (Variant(),)
N = 2


def impulses(always: float = 0.0, engaged: float = 0.0) -> np.ndarray:
    """Impulses [Nm s] of which e(k) of the variant is the sum of what always acts, and of what acts
    while engaged."""
    impulse = np.zeros(len(ROW))
    impulse[ROW["momentum"]], impulse[ROW["rotor"]] = always, engaged
    return impulse


def test_step_response_is_tustins_first_order_filter() -> None:
    # Constant external torque: the momentum grows by tau T each tick. The pole of (13), and the
    # continuous filter within its discretisation error.
    residual = Residual(BACKLASH, K, T, N)
    tau = (1.0, -3.0)
    pole = (2 - T * K) / (2 + T * K)
    for k in range(1, 60):
        for i in range(N):
            residual.step(i, impulses(tau[i] * T), 0.0, True, T)
            r = residual.values[0, i]
            assert r == pytest.approx(tau[i] * (1 - pole**k), rel=1e-12)
            assert r == pytest.approx(tau[i] * (1 - np.exp(-K * k * T)), abs=0.01 * 3)


def test_half_of_a_step_after_ln2_over_gain() -> None:
    residual = Residual(BACKLASH, K, 0.001, 1)
    k = 0
    while residual.values[0, 0] < 0.5:
        residual.step(0, impulses(0.001), 0.0, True, 0.001)
        k += 1
    assert k * 0.001 == pytest.approx(np.log(2) / K, abs=0.001)


def test_true_intervals_give_the_same_end() -> None:
    # One missed tick: the momentum of both intervals arrives at once, over twice the time.
    even, uneven = Residual(BACKLASH, K, T, 1), Residual(BACKLASH, K, T, 1)
    for _ in range(4):
        even.step(0, impulses(T), 0.0, True, T)
    for dt in (T, 2 * T, T):
        uneven.step(0, impulses(dt), 0.0, True, dt)
    assert uneven.values[0, 0] == pytest.approx(even.values[0, 0], abs=0.01)
    assert uneven.values[0, 0] != even.values[0, 0]


def test_linear_in_what_acts() -> None:
    rng = np.random.default_rng(5)
    series = rng.normal(size=(2, 40, len(ROW)))
    kinds = [Variant(kind=k, label=k) for k in ("classical", "backlash", "two_mass")]
    first, second, both = (Residual(kinds, K, T, 1) for _ in range(3))
    for a, b in zip(*series, strict=True):
        first.step(0, a, 0.1, True, T)
        second.step(0, b, 0.2, True, T)
        both.step(0, 2 * a - b, 0.0, True, T)
    values = 2 * np.asarray(first.values) - np.asarray(second.values)
    np.testing.assert_allclose(both.values, values, atol=1e-12)


@pytest.mark.parametrize(("touched", "e"), [(True, 3.0 * T - 0.001), (False, T)])
def test_what_acts_while_engaged_is_left_out_in_the_gap(touched: bool, e: float) -> None:
    residual = Residual(BACKLASH, K, T, N)
    residual.step(1, impulses(T, 2 * T), 0.001, touched, T)
    assert residual.values[0, 1] == pytest.approx(e * 2 * K / (2 + T * K))
    assert residual.values[0, 0] == 0.0


def test_only_variants_with_engagement_are_corrected_by_a_fit() -> None:
    kinds = [Variant(kind=k, label=k) for k in ("classical", "backlash", "two_mass")]
    residual = Residual(kinds, K, T, 1)
    residual.step(0, impulses(), 0.001, True, T)
    assert [bool(r) for r in np.asarray(residual.values)[:, 0]] == [False, True, False]


def test_an_interval_beyond_the_pole_is_its_mean() -> None:
    residual = Residual(BACKLASH, K, T, 1)
    residual.values[0, 0] = 7.0
    residual.step(0, impulses(0.3), 0.0, True, 0.1)
    assert residual.values[0, 0] == pytest.approx(3.0)


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
