"""The kernel against the estimator in arrays, on motions with samples missing, and against itself
uncompiled."""

from types import ModuleType

import numpy as np
import pytest

from estimator.estimate import Estimate, Flag
from estimator.estimator import Estimator as Chain
from estimator.interval import TERMS
from estimator.residual import Variant, forms
from tests.estimator.in_arrays import Estimator
from tests.estimator.plain import built, plain

T = 0.01
N = 7
BESIDE = (
    Variant(kind="classical", friction=False, rotor_inertia=False),
    Variant(kind="two_mass"),
    Variant(rotor_inertia=False),
    Variant(friction=False),
)
SHOWN = ("q", "q_dot", "theta", "phi_sigma", "tau_M", "residual", "threshold")


def weights(variants: tuple[Variant, ...]) -> dict[str, np.ndarray]:
    always, engaged = np.zeros((2, len(variants), len(TERMS)))
    for row, variant in enumerate(variants):
        for table, form in zip((always, engaged), forms(variant), strict=True):
            for name, weight in form.items():
                table[row, TERMS.index(name)] = weight
    corrected = np.array([float(v.kind == "backlash") for v in variants])
    return {"always": always, "engaged": engaged, "corrected": corrected}


def kernel_of(modules: dict[str, ModuleType], like: Estimator) -> object:
    """A kernel of these modules with the parameters of an estimator."""
    model, t, s, a = like.model, like.transmission, like.settings, like.alignment
    bodies = [
        modules["dynamics"].Body(**{f: getattr(b, f) for f in b.__slots__}) for b in model.bodies()
    ]
    return modules["kernel"].Kernel(
        t,
        s,
        like._thresholds,
        modules["dynamics"].Dynamics(bodies, model.down),
        modules["gap"].Gap(t, s.gap, s.motor_position == "measured"),
        period_s=like.period_s,
        ages=(a._back, a._current_age, a._velocity_age, a._position_age),
        **weights((s.residual, *s.beside)),
    )


def in_arrays(chain: Chain) -> Estimator:
    """The estimator in arrays with the parameters of another."""
    c = chain
    return Estimator(c.model, c.transmission, c.settings, c._thresholds, c.period_s)


def samples(recording: object, k: int) -> np.ndarray:
    r = recording
    return np.array([r.current[k], r.theta_dot[k], r.theta[k], r.q[k]])


def step(kernel: object, rows: np.ndarray, came: np.ndarray, dt: float = T) -> int:
    np.asarray(kernel.samples)[:] = rows
    np.asarray(kernel.came)[:] = came
    return kernel.step(dt)


def masks(seed: int, ticks: int) -> np.ndarray:
    """Samples that come: all at first, then some joints lose some, now and then for long."""
    rng = np.random.default_rng(seed)
    came = rng.random((ticks, N)) > 0.15
    for _ in range(ticks // 60):
        start, joint, length = rng.integers(ticks), rng.integers(N), rng.integers(2, 10)
        came[start : start + length, joint] = False
    came[: ticks // 8] = True
    return came


def compare(kernel: object, estimate: Estimate, flags: int, where: str) -> None:
    assert flags == estimate.flags, where
    values = {name: np.asarray(getattr(kernel, name)) for name in ("q", "q_dot", "tau_M")}
    values |= {
        "theta": np.asarray(kernel.rotors.theta),
        "phi_sigma": np.asarray(kernel.rotors.sigma),
        "residual": np.asarray(kernel.residual)[0],
        "threshold": np.asarray(kernel.threshold),
    }
    for name in SHOWN:
        expected = getattr(estimate, name)
        np.testing.assert_allclose(values[name], expected, rtol=0, atol=2e-12, err_msg=where + name)
    for row, name in enumerate(estimate.beside, start=1):
        expected, found = estimate.beside[name], np.asarray(kernel.residual)[row]
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-12, err_msg=where + name)
    np.testing.assert_array_equal(np.asarray(kernel.rotors.side), estimate.side, err_msg=where)
    np.testing.assert_array_equal(np.asarray(kernel.sensing), estimate.sensing, err_msg=where)


@pytest.mark.parametrize("source", ["integrated", "measured"])
@pytest.mark.parametrize(
    ("method", "debounce", "lossy", "seed"),
    [("midpoint", 1, False, 0), ("midpoint", 2, True, 1), ("central", 3, True, 2),
     ("backward", 1, True, 3)],
)  # fmt: skip
def test_the_kernel_is_the_estimator(
    make_estimator, sine_motion, pushed_motion, source, debounce, lossy, seed, method
) -> None:
    for motion in (sine_motion, pushed_motion):
        chain = make_estimator(
            beside=BESIDE, motor_position=source, debounce=debounce, link_velocity=method
        )
        estimator = in_arrays(chain)
        kernel = kernel_of(built(), estimator)
        ticks = 1200 if motion is pushed_motion else 500
        came = masks(seed, ticks) if lossy else np.ones((ticks, N), dtype=bool)
        begun = 0
        for k in range(ticks):
            rows = samples(motion, k)
            estimate = estimator.step(rows[0], rows[3], rows[1], rows[2], T, fresh=came[k])
            flags = step(kernel, rows, came[k])
            compare(kernel, estimate, flags, f"tick {k}: ")
            begins = np.argwhere(np.asarray(kernel.begins))
            assert len(begins) == len(estimate.contacts), k
            for (level, joint), contact in zip(begins, estimate.contacts, strict=True):
                assert estimator.model.names[joint] == contact.joint
                assert ("contact", "collision")[level] == contact.level
            begun += len(begins)
        assert begun > 0 or motion is sine_motion
        if lossy:
            assert (came.sum(axis=1) < N).any()


@pytest.mark.parametrize(("dt", "bad"), [(T, np.nan), (T, -np.inf), (0.0, 0.0), (np.inf, 0.0),
                                         (T, 1e200), (T, -1e300)])  # fmt: skip
def test_what_is_not_finite(make_estimator, sine_motion, dt: float, bad: float) -> None:
    estimator = in_arrays(make_estimator(beside=BESIDE))
    kernel = kernel_of(built(), estimator)
    came = np.ones(N, dtype=bool)
    for k in range(300):
        rows = samples(sine_motion, k)
        if k == 200:
            rows[3, 4] += bad
        now = dt if k == 200 else T
        with np.errstate(all="ignore"):
            estimate = estimator.step(rows[0], rows[3], rows[1], rows[2], now)
        flags = step(kernel, rows, came, now)
        if k == 200:
            assert flags & Flag.INVALID
            assert estimate.flags == Flag.INVALID
        else:
            compare(kernel, estimate, flags, f"tick {k}: ")


@pytest.mark.parametrize("source", ["integrated", "measured"])
def test_compiled_and_plain_are_the_same_to_the_last_bit(
    make_estimator, pushed_motion, source: str
) -> None:
    estimator = in_arrays(make_estimator(beside=BESIDE, motor_position=source, debounce=2))
    compiled, python = (kernel_of(modules, estimator) for modules in (built(), plain()))
    if type(compiled).step is type(python).step:
        pytest.skip("the modules are not compiled here")
    came = masks(5, 300)
    for k in range(300):
        rows = samples(pushed_motion, 650 + k)
        assert step(compiled, rows, came[k]) == step(python, rows, came[k])
    for owner in ("", "rotors"):
        one, other = (getattr(x, owner) if owner else x for x in (compiled, python))
        public = [name for name in vars(other) if not name.startswith("_") and name != "rotors"]
        assert len(public) > 9
        for name in public:
            a, b = np.asarray(getattr(one, name)), np.asarray(getattr(other, name))
            assert a.tobytes() == b.tobytes(), (owner, name)
