"""The estimator against the one in arrays, on motions with samples missing; and its kernel against
itself uncompiled."""

import os
import subprocess
import sys
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from estimator import memory
from estimator.estimate import Estimate, Flag
from estimator.estimator import Estimator
from estimator.settings import Variant
from estimator.thresholds import Thresholds
from tests.estimator.in_arrays.estimator import Estimator as InArrays
from tests.estimator.plain import built, plain

T = 0.01
N = 7
BESIDE = (
    Variant(kind="classical", friction=False, rotor_inertia=False),
    Variant(kind="two_mass"),
    Variant(rotor_inertia=False),
    Variant(friction=False),
)
CONTACT = np.array([0.8, 0.5, 0.4, 0.3, 0.2, 0.2, 0.2])
LEVELS = Thresholds(CONTACT, 6 * CONTACT, per_speed=np.array(0.05))
EXACT = ("side", "sensing")
CLOSE = ("q", "q_dot", "theta", "phi_sigma", "tau_M", "residual", "threshold", "thresholded")


def both(like: Estimator) -> tuple[Estimator, InArrays]:
    """An estimator and one in arrays, with the parameters of another and levels that grow."""
    parts = like.model, like.transmission, like.settings, LEVELS, like.period_s
    return Estimator(*parts), InArrays(*parts)


def rows(motion: Any, k: int) -> tuple[np.ndarray, ...]:
    return motion.current[k], motion.q[k], motion.theta_dot[k], motion.theta[k]


def masks(seed: int, ticks: int) -> np.ndarray:
    """Samples that come: all at first, then some joints lose some, now and then for long."""
    rng = np.random.default_rng(seed)
    came = rng.random((ticks, N)) > 0.15
    for _ in range(ticks // 40):
        start, joint, length = rng.integers(ticks), rng.integers(N), rng.integers(3, 14)
        came[start : start + length, joint] = False
    came[: ticks // 8] = True
    return came


def compare(found: Estimate, expected: Estimate, where: str) -> None:
    assert found.flags == expected.flags, where
    assert found.touched_link == expected.touched_link, where
    for name in EXACT:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), where + name)
    values = {name: (getattr(found, name), getattr(expected, name)) for name in CLOSE}
    values |= {name: (found.beside[name], r) for name, r in expected.beside.items()}
    for name, (value, other) in values.items():
        np.testing.assert_allclose(value, other, rtol=0, atol=2e-12, err_msg=where + name)
    assert len(found.contacts) == len(expected.contacts), where
    for one, other in zip(found.contacts, expected.contacts, strict=True):
        assert (one.joint, one.level, one.side) == (other.joint, other.level, other.side), where
        assert one.torque == pytest.approx(other.torque, abs=2e-12)
        assert one.threshold == pytest.approx(other.threshold, abs=2e-12)


@pytest.mark.parametrize("source", ["integrated", "measured"])
@pytest.mark.parametrize(
    ("method", "debounce", "lossy", "seed"),
    [("midpoint", 1, False, 0), ("midpoint", 2, True, 1), ("central", 3, True, 2),
     ("backward", 1, True, 3)],
)  # fmt: skip
def test_the_kernel_is_the_estimator_in_arrays(
    make_estimator, sine_motion, pushed_motion, source, debounce, lossy, seed, method
) -> None:
    for motion in (sine_motion, pushed_motion):
        settings = {"motor_position": source, "debounce": debounce, "link_velocity": method}
        ours, in_arrays = both(make_estimator(beside=BESIDE, **settings))
        ticks = 1200 if motion is pushed_motion else 500
        came = masks(seed, ticks) if lossy else np.ones((ticks, N), dtype=bool)
        begun, flags = 0, Flag(0)
        for k in range(ticks):
            estimates = [e.step(*rows(motion, k), T, fresh=came[k]) for e in (ours, in_arrays)]
            compare(*estimates, f"tick {k}: ")
            begun += len(estimates[0].contacts)
            flags |= estimates[0].flags
        assert begun > 0 or motion is sine_motion
        assert (Flag.RESTARTED | Flag.RAISED | Flag.BRIDGED in flags) == lossy


@pytest.mark.parametrize(("dt", "bad"), [(T, np.nan), (T, -np.inf), (0.0, 0.0), (np.inf, 0.0),
                                         (T, 1e200), (T, -1e300)])  # fmt: skip
def test_what_is_not_finite(make_estimator, sine_motion, dt: float, bad: float) -> None:
    ours, in_arrays = both(make_estimator(beside=BESIDE))
    for k in range(300):
        samples, now = [row.copy() for row in rows(sine_motion, k)], T
        if k == 200:
            samples[1][4] += bad
            now = dt
        with np.errstate(all="ignore"):
            found, expected = (e.step(*samples, now) for e in (ours, in_arrays))
        assert (Flag.INVALID in found.flags) == (k == 200)
        compare(found, expected, f"tick {k}: ")


@pytest.mark.parametrize("link", [0.3, np.nan])
def test_a_joint_whose_first_sample_is_to_come(make_estimator, sine_motion, link: float) -> None:
    """It stands where it was last seen, or at zero, until all have begun."""
    ours, in_arrays = both(make_estimator(beside=BESIDE))
    fresh = np.ones(N, dtype=bool)
    for k in range(20):
        current, q, theta_dot, theta = rows(sine_motion, k)
        fresh[2] = k > 8
        q = np.where(fresh, q, link)
        samples = current, q, theta_dot, theta
        found, expected = (e.step(*samples, T, fresh=fresh) for e in (ours, in_arrays))
        compare(found, expected, f"tick {k}: ")
        if k == 5:
            assert found.q[2] == np.nan_to_num(link)


def kernel_of(modules: dict[str, ModuleType], like: Estimator) -> Any:
    """A kernel of these modules with the parameters of an estimator."""
    bodies, down = like.model.bodies(), like.model.down
    return modules["kernel"].Kernel(
        modules["dynamics"].Dynamics(bodies, down),
        like.transmission,
        like.settings,
        LEVELS,
        like.period_s,
        like.model.place(),
    )


def state(kernel: Any) -> bytes:
    levels = kernel.levels
    arrays = (
        kernel.shown,
        kernel.wrench.shown,
        kernel.sensing,
        levels.collision,
        levels.above,
        levels.share,
        levels.crossing,
    )
    shown = b"".join(np.asarray(values).tobytes() for values in arrays)
    return shown + repr(memory.dump(kernel)).encode()


@pytest.mark.parametrize("learning", [False, True])
@pytest.mark.parametrize("source", ["integrated", "measured"])
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of numpy's, where the plain one overflows
def test_compiled_and_plain_are_the_same_to_the_last_bit(
    make_estimator, pushed_motion, source: str, learning: bool
) -> None:
    settings = {"motor_position": source, "debounce": 2, "learning": learning}
    like = make_estimator(beside=BESIDE, **settings)
    compiled, python = (kernel_of(modules, like) for modules in (built(), plain()))
    if type(compiled).step is type(python).step:
        pytest.skip("the modules are not compiled here")
    came, flags = masks(5, 300), 0
    for k in range(300):
        current, q, theta_dot, theta = rows(pushed_motion, 650 + k)
        samples = np.array([current, theta_dot, theta, q])
        samples[3, 1] += {120: np.nan, 180: 1e200}.get(k, 0.0)
        answers = []
        for kernel in (compiled, python):
            np.asarray(kernel.alignment.samples)[:] = samples
            np.asarray(kernel.came)[:] = came[k] | (k in (120, 180))
            if k == 220:
                kernel.restart(3)
            if k == 260:
                kernel.reset(4)
            answers.append((int(kernel.step(T)), int(kernel.begun), state(kernel)))
        assert answers[0] == answers[1], k
        flags |= answers[0][0]
    assert flags == sum(Flag)


HASH = """
import hashlib
import numpy as np
from tests.estimator.conftest import estimator
from estimator.dynamics import Body, Dynamics
from estimator.settings import Variant
made = estimator(beside=(Variant(kind="two_mass"),), learning=True)
done = hashlib.sha256()
walk = np.random.default_rng(4).integers(-40, 41, (300, 3, 7)).cumsum(axis=0) * 1e-5
for current, q, theta_dot in walk * [[[100.0], [1.0], [20.0]]]:
    e = made.step(current, q, theta_dot)
    for values in (e.residual, e.beside["two_mass"], e.threshold, e.theta, e.phi_sigma):
        done.update(values.tobytes())
learned = made.memory()["learning"]
assert np.any(learned["shares"])

# Joints whose axes and frames are those of no coordinate.
rng, bodies = np.random.default_rng(5), []
for row in range(4):
    w, x, y, z = rng.normal(size=4)
    square = w * w + x * x + y * y + z * z
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    outer = np.array([[x * x, x * y, x * z], [x * y, y * y, y * z], [x * z, y * z, z * z]])
    about = outer - (square - w * w) * np.eye(3)
    rotation = np.eye(3) + 2.0 / square * (w * cross + about)
    axis = rng.normal(size=(2, 3)) * [[row < 3], [row == 3]]
    place, moment = rng.normal(size=(2, 3))
    bodies.append(Body(row - 1, row, rotation, place, *axis, 1.3, moment, np.eye(3)))
dynamics = Dynamics(bodies, np.array([0.0, 0.6, -9.7]))
for q, q_dot in rng.normal(size=(50, 2, 4)):
    dynamics.at(q, q_dot)
    done.update(np.array([dynamics.momentum, dynamics.beta]).tobytes())
print(done.hexdigest(), int(e.flags))
"""
OTHER_PROCESSOR = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4",
    "OPENBLAS_CORETYPE": "Prescott",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX2_Usable,-FMA_Usable",
}


def test_the_bits_are_those_of_every_processor() -> None:
    """Whatever code numpy, OpenBLAS and the C library choose for this one."""
    said = [
        subprocess.run(
            [sys.executable, "-W", "ignore", "-c", HASH],
            env={**os.environ, **settings},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.split()
        for settings in ({}, OTHER_PROCESSOR)
    ]
    assert said[0] == said[1]
    assert said[0][1] == "0"
