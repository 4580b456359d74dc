"""The estimator against its golden answers, and its kernel against itself uncompiled."""

import os
import subprocess
import sys
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from estimator import memory
from estimator.estimate import Flag
from estimator.estimator import Estimator
from tests.estimator import golden
from tests.estimator.golden import BESIDE, LEVELS, RUNS, Run, T
from tests.estimator.plain import built, plain


@pytest.mark.parametrize("run", RUNS, ids=lambda run: run.name)
def test_the_answers_are_the_golden_ones(run: Run) -> None:
    with np.load(golden.FILE) as kept:
        answers = golden.of(run, kept["samples"])
        assert [name for name in answers if not golden.same(answers[name], kept[name])] == []


def test_the_golden_runs_reach_all_that_matters() -> None:
    with np.load(golden.FILE) as kept:
        flags = {run: np.bitwise_or.reduce(kept[f"{run.name}: flags"]) for run in RUNS}
        contacts = {run: len(kept[f"{run.name}: contacts"]) for run in RUNS}
    lossy = Flag.RESTARTED | Flag.RAISED | Flag.BRIDGED
    for run in RUNS:
        assert (lossy & flags[run] == lossy) == run.lossy, run.name
        assert (Flag.INVALID in Flag(flags[run])) == run.name.startswith("bad"), run.name
        assert contacts[run] > 0 or run.ticks < 600, run.name


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
        kernel.shown, kernel.wrench.shown, kernel.sensing, levels.collision, levels.above,
        levels.share, levels.crossing,
    )  # fmt: skip
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
    arrived, flags = golden.arrivals(300), 0
    for k in range(300):
        m, at = pushed_motion, 650 + k
        samples = np.array([m.current[at], m.theta_dot[at], m.theta[at], m.q[at]])
        samples[3, 1] += {120: np.nan, 180: 1e200}.get(k, 0.0)
        answers = []
        for kernel in (compiled, python):
            np.asarray(kernel.alignment.samples)[:] = samples
            np.asarray(kernel.arrived)[:] = arrived[k] | (k in (120, 180))
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
