"""Compiled modules: those that are, those that should be, and the warning about the others."""

import sys
from types import ModuleType

import numpy as np

from common.compiled import uncompiled, warning
from tests.plain import COMPILED, built, plain


def test_modules_of_every_folder_are_compiled() -> None:
    folders = {name.rpartition(".")[0] for name in COMPILED}
    assert folders == {
        "common",
        "daemon.faults",
        "daemon.motion",
        "drivers",
        "estimator",
        "simulator",
    }
    assert all(str(m.__file__).endswith(".py") for m in plain("daemon.faults").values())
    assert built("daemon.faults")["measures"] is sys.modules["daemon.faults.measures"]


def test_a_plain_module_is_named(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "estimator.dynamics", plain("estimator")["dynamics"])
    assert "estimator.dynamics" in uncompiled()
    assert "estimator.dynamics" in warning()
    assert "python3-dev" in warning()


def test_checks_limits_and_counts_are_the_same_plain_to_the_last_bit() -> None:
    """Those of the estimator and of the simulator have tests of their own."""
    folders = ("daemon.faults", "daemon.motion", "drivers", "estimator")
    as_built = [judged({**built(f)}) for f in folders]
    as_plain = [judged({**plain(f)}) for f in folders]
    assert [len(bits) for bits in as_built] == [300, 200, 200, 100]
    assert as_built == as_plain


def judged(modules: dict[str, ModuleType]) -> list[bytes]:
    """Results of a folder's functions for 100 random ticks of three joints, as bytes."""
    rng, n, made = np.random.default_rng(1), 3, list[np.ndarray]()
    ones, out = np.ones(n), np.zeros(n)
    if measures := modules.get("measures"):
        judge = measures.Measures(
            np.full((8, n), 0.5), middle=0.1 * ones, play=0.05 * ones, full_current=0.8 * ones,
            speed=ones, standstill=0.02, motor_drift=0.001, motor_scale_error=0.01,
        )  # fmt: skip
    if bounding := modules.get("bounding"):
        limits = bounding.Bounding(-ones, ones, 0.5 * ones, 4.0 * ones, 0.01)
    for k in range(100):
        q, velocity, current, residual = rng.normal(size=(4, n)) * rng.choice([0.01, 1.0])
        dt, way = 0.01 * (rng.random(n) > 0.2), np.abs(rng.normal(size=(2, n))) * 0.01
        if measures:
            position = None if k < 50 else q + 0.01 * rng.normal(size=n)
            beyond = judge.step(q, velocity, position, current, residual, dt, k % 7 > 0)
            near = measures.within(q, velocity, ones)
            made += [np.array(judge.measures), np.array(judge.bounds), np.array([beyond, near])]
        if bounding:
            for bound in (limits.bound_velocity, limits.soft_stop):
                given = (current, 0.01) if bound == limits.bound_velocity else ()
                bound(q, velocity, *(given or (8.0,)), way, out)
                made.append(out.copy())
        if counts := modules.get("counts"):
            values, raw = np.zeros((2, n)), rng.integers(-1000, 1000, 2 * n).astype(float).tolist()
            order = np.arange(2 * n).reshape(2, n)
            counts.decode(raw, order, rng.normal(size=(2, n)), rng.normal(size=(2, n)), values)
            good = counts.encode(velocity, 1e-3 * ones, 0.1 * ones, -500 * ones, 500 * ones, out)
            made += [values, np.append(out, good)]
        if play := modules.get("play"):
            play.put_play(0.02 * ones, 0.02 * q, way[0], way)
            made.append(way)
    return [one.astype(np.float64).tobytes() for one in made]
