"""Golden answers of the estimator, to runs with samples missing or not finite.

`golden.npz` was written when a second estimator, in arrays over all joints, agreed with it to 2e-12
in every tick (`tests/estimator/in_arrays`, up to commit 824fd999). After a change of what the
estimator computes, `PYTHONPATH=. .venv/bin/python tests/estimator/golden.py` names the answers that
differ and writes all anew.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from estimator.estimate import Estimate
from estimator.estimator import Estimator
from estimator.settings import Variant
from estimator.thresholds import Thresholds
from tests.estimator import conftest

FILE: Final = Path(__file__).with_suffix(".npz")
T, N = 0.01, 7
BESIDE: Final = (
    Variant(kind="classical", friction=False, rotor_inertia=False),
    Variant(kind="two_mass"),
    Variant(rotor_inertia=False),
    Variant(friction=False),
)
LEVELS: Final = Thresholds(conftest.CONTACT, 6 * conftest.CONTACT, per_speed=np.array(0.05))
TRANSMISSION: Final = conftest.transmission(
    gap_coulomb=0.1 * conftest.COULOMB, gap_viscous=0.05 * conftest.VISCOUS,
    contact_stiffness=9.0 * (conftest.ALPHA > 0.0),
    contact_damping=0.2 * (conftest.ALPHA > 0.0),
)  # fmt: skip
EXACT = ("side", "sensing")
CLOSE = ("q", "q_dot", "theta", "phi_sigma", "tau_M", "residual", "threshold", "thresholded")
EVERY: Final = 30  # ticks from one row of arrays to the next; flags and contacts are of all


@dataclass(frozen=True, slots=True)
class Run:
    """One run: its settings, and what is wrong with its samples."""

    name: str
    ticks: int = 300
    settings: tuple[tuple[str, object], ...] = ()
    lossy: bool = False
    bad: tuple[float, float] = (T, 0.0)  # dt [s] and what is added to a link position, at tick 200
    late: float = 0.0  # link position [rad] of joint 2 before its first sample, until tick 8


RUNS: Final = (
    *(
        Run(
            f"{source} {method} {debounce}",
            600,
            (("motor_position", source), ("link_velocity", method), ("debounce", debounce)),
            lossy,
        )
        for source in ("integrated", "measured")
        for method, debounce, lossy in (
            ("midpoint", 1, False), ("midpoint", 2, True), ("central", 3, True),
            ("backward", 1, True),
        )
    ),
    *(
        Run(f"bad {dt} {added}", bad=(dt, added))
        for dt, added in ((T, np.nan), (T, -np.inf), (0.0, 0.0), (np.inf, 0.0), (T, 1e200))
    ),
    Run("late", 20, late=0.3),
    Run("late without a position", 20, late=np.nan),
)  # fmt: skip


def recorded() -> np.ndarray:
    """Current [A], q, theta_dot, theta (ticks, 4, N) of the simulated arm on sines; each joint is
    pushed by twice its level from 4 s on. Kept with the answers: the simulator may change."""
    motion = conftest.record(
        6.0, conftest.sines(), lambda t: 2 * conftest.CONTACT * (t >= 4.0), seed=1
    )
    rows = motion.current, motion.q, motion.theta_dot, motion.theta
    return np.stack(rows, axis=1).astype(np.float32)


def arrivals(ticks: int) -> np.ndarray:
    """Samples that come: all at first, then some joints lose some, now and then for long."""
    rng = np.random.default_rng(ticks)
    came = rng.random((ticks, N)) > 0.15
    for _ in range(ticks // 40):
        start, joint, length = rng.integers(ticks), rng.integers(N), rng.integers(3, 14)
        came[start : start + length, joint] = False
    came[: ticks // 8] = True
    return came


def estimates(run: Run, samples: np.ndarray, estimator: Estimator) -> list[Estimate]:
    """Answers of an estimator to the run, one a tick."""
    came = arrivals(run.ticks) if run.lossy else np.ones((run.ticks, N), dtype=bool)
    answers = []
    for k, (current, q, theta_dot, theta) in enumerate(samples[: run.ticks].astype(float)):
        dt, added = run.bad if k == 200 else (T, 0.0)
        q[4] += added
        if run.late and k <= 8:
            came[k, 2], q[2] = False, run.late
        with np.errstate(all="ignore"):
            answers.append(estimator.step(current, q, theta_dot, theta, dt, fresh=came[k]))
    return answers


def rows(run: Run, answers: Sequence[Estimate]) -> dict[str, np.ndarray]:
    """Values that are kept, by name."""
    some = [e for k, e in enumerate(answers) if k % EVERY == EVERY // 2 or e.contacts]
    kept = {name: np.array([getattr(e, name) for e in some]) for name in (*EXACT, *CLOSE)}
    kept |= {f"beside {name}": np.array([e.beside[name] for e in some]) for name in some[0].beside}
    contacts = [
        (k, conftest.JOINTS.index(c.joint), c.level == "collision", c.side, c.torque, c.threshold)
        for k, e in enumerate(answers)
        for c in e.contacts
    ]
    kept["contacts"] = np.array(contacts).reshape(-1, 6)
    kept["flags"] = np.array([e.flags for e in answers], dtype=np.uint8)
    kept["touched"] = np.array([(e.touched_link or "none").encode() for e in answers])
    return {f"{run.name}: {name}": values for name, values in kept.items()}


def of(run: Run, samples: np.ndarray) -> dict[str, np.ndarray]:
    """Answers of today's estimator."""
    like = conftest.estimator(beside=BESIDE, **dict(run.settings))
    parts = like.model, TRANSMISSION, like.settings, LEVELS, like.period_s
    return rows(run, estimates(run, samples, Estimator(*parts)))


def same(found: np.ndarray, golden: np.ndarray) -> bool:
    """Whether answers are the golden ones, to rounding."""
    if found.shape != golden.shape or found.dtype.kind != golden.dtype.kind:
        return False
    if found.dtype.kind != "f":
        return bool(np.array_equal(found, golden))
    return bool(np.allclose(found, golden, rtol=0, atol=2e-12, equal_nan=True))


def main() -> None:
    """Write the answers anew."""
    golden = dict(np.load(FILE)) if FILE.exists() else {"samples": recorded()}
    samples = golden["samples"]
    answers = {name: values for run in RUNS for name, values in of(run, samples).items()}
    answers["samples"] = samples
    for name in sorted(answers.keys() | golden.keys()):
        if name not in golden or name not in answers or not same(answers[name], golden[name]):
            print(name)
    np.savez_compressed(FILE, **answers)


if __name__ == "__main__":
    main()
