"""Residuals: closed form of the first-order filter, linearity, refusals, the variants' meaning."""

import msgspec
import numpy as np
import pytest

from errors import ModelError
from estimator.residual import IMPULSES, Residual, Variant

K, T = 25.0, 0.01
BACKLASH = (Variant(),)


def impulses(**rows: object) -> np.ndarray:
    table = np.zeros((len(IMPULSES), 2))
    for name, row in rows.items():
        table[IMPULSES.index(name)] = row
    return table


def test_step_response_is_tustins_first_order_filter() -> None:
    # Constant external torque: the momentum grows by tau T each tick. The pole of (13), and the
    # continuous filter within its discretisation error.
    residual = Residual(BACKLASH, K, T, 2)
    tau = np.array([1.0, -3.0])
    pole = (2 - T * K) / (2 + T * K)
    for k in range(1, 60):
        r = residual.step(impulses(inertial=tau * T), T)[0]
        np.testing.assert_allclose(r, tau * (1 - pole**k), rtol=1e-12)
        np.testing.assert_allclose(r, tau * (1 - np.exp(-K * k * T)), atol=0.01 * 3)


def test_half_of_a_step_after_ln2_over_gain() -> None:
    residual = Residual(BACKLASH, K, 0.001, 1)
    k = 0
    while residual.values[0, 0] < 0.5:
        residual.step(impulses(inertial=0.001)[:, :1], 0.001)
        k += 1
    assert k * 0.001 == pytest.approx(np.log(2) / K, abs=0.001)


def test_true_intervals_give_the_same_end() -> None:
    # One missed tick: the momentum of both intervals arrives at once, over twice the time.
    even, uneven = Residual(BACKLASH, K, T, 1), Residual(BACKLASH, K, T, 1)
    for _ in range(4):
        even.step(impulses(inertial=T)[:, :1], T)
    for dt in (T, 2 * T, T):
        uneven.step(impulses(inertial=dt)[:, :1], dt)
    assert uneven.values[0, 0] == pytest.approx(even.values[0, 0], abs=0.01)
    assert uneven.values[0, 0] != even.values[0, 0]


def test_linear_in_what_acts() -> None:
    rng = np.random.default_rng(5)
    series = rng.normal(size=(2, 40, len(IMPULSES), 2))
    kinds = [Variant(kind=k, label=k) for k in ("classical", "backlash", "two_mass")]
    first, second, both = (Residual(kinds, K, T, 2) for _ in range(3))
    for a, b in zip(*series, strict=True):
        first.step(a, T)
        second.step(b, T)
        both.step(2 * a - b, T)
    np.testing.assert_allclose(both.values, 2 * first.values - second.values, atol=1e-12)


def test_an_interval_beyond_the_pole_is_its_mean() -> None:
    residual = Residual(BACKLASH, K, T, 2)
    residual.values[:] = 7.0
    residual.step(impulses(inertial=0.3), 0.1)
    np.testing.assert_allclose(residual.values, 3.0)


@pytest.mark.parametrize(
    ("variant", "acting"),
    [
        (Variant(kind="classical", friction=False, rotor_inertia=False), "-motor"),
        (Variant(kind="classical", rotor_inertia=False), "-motor +rubbing"),
        (Variant(kind="classical"), "-motor +rubbing +rotor"),
        (Variant(), "-engaged_motor +switched +engaged_rotor"),
        (Variant(rotor_inertia=False), "-engaged_motor +switched"),
        (Variant(friction=False), "-engaged_motor +engaged_rotor"),
        (Variant(kind="two_mass"), "-motor +two_sided +rotor"),
        (Variant(kind="two_mass", friction=False), "-motor +rotor"),
    ],
)
def test_what_each_variant_believes(variant: Variant, acting: str) -> None:
    signs = {word[1:]: float(word[0] + "1") for word in acting.split()} | {"inertial": 1.0}
    for name in IMPULSES:
        residual = Residual([variant], K, T, 2)
        r = residual.step(impulses(**{name: T}), T)[0]
        np.testing.assert_allclose(r, signs.get(name, 0.0) * 2 * K * T / (2 + T * K))


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
