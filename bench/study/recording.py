"""Recording of a lockstep run: one row per tick, from both ends of the bus.

    recorder = Recorder(rig)
    rig.run(20.0, recorder)
    recording = recorder.recording()

The plant's rows are the truth at the instant of the samples; the estimator's rows refer to
`delay_s` before it (half a period for the link velocity `midpoint`).
"""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.rigs.lockstep import Rig
from common.arrays import Matrix, Vector
from daemon.config.schema import Configuration
from estimator.contact import dead_band


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """Arrays of one run; (ticks,) or (ticks, n)."""

    configuration: Configuration
    delay_s: float  # by which the estimator's rows precede the samples
    time_s: Vector  # since the recording began
    mode: NDArray[np.str_]
    # The plant, in truth.
    true_q: Matrix
    true_theta: Matrix
    true_in_gap: NDArray[np.bool_]
    true_torque: Matrix  # external torque [Nm]
    # The daemon: samples, estimate, decision.
    motor_velocity: Matrix
    q: Matrix
    q_dot: Matrix
    phi: Matrix
    side: NDArray[np.int8]
    tau_M: Matrix
    threshold: Matrix
    reference: Matrix
    residuals: dict[str, Matrix]  # by the name of the variant, the one that decides first [Nm]

    @property
    def joints(self) -> list[str]:
        """Names, in the order of the columns."""
        return self.configuration.joint_names

    def thresholded(self, name: str) -> Matrix:
        """Residual `name` beyond the thresholds in force [Nm]."""
        return dead_band(self.residuals[name], self.threshold)

    def part(self, begin_s: float, end_s: float) -> "Recording":
        """Ticks with begin_s <= time_s < end_s."""
        ticks = (self.time_s >= begin_s) & (self.time_s < end_s)
        arrays = {
            f.name: getattr(self, f.name)[ticks]
            for f in fields(self)
            if isinstance(getattr(self, f.name), np.ndarray)
        }
        residuals = {name: values[ticks] for name, values in self.residuals.items()}
        return replace(self, **arrays, residuals=residuals)


class Recorder:
    """Recorder to be called after every tick of `rig`; the drives' samples must be complete."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._begin_s: float | None = None
        self._rows: list[dict[str, Any]] = []
        self._residuals: list[dict[str, Vector]] = []

    def __call__(self) -> None:
        rig, plant = self._rig, self._rig.arm.plant
        samples, estimate, decision = rig.samples, rig.estimate, rig.decision
        assert samples.fresh.all()
        now = rig.time_s
        self._begin_s = now if self._begin_s is None else self._begin_s
        row = {
            "time_s": round(now - self._begin_s, 9),
            "mode": rig.mode.value,
            "true_q": plant.q.copy(),
            "true_theta": plant.theta,
            "true_in_gap": plant.in_gap,
            "true_torque": rig.arm.tau_ext.copy(),
            "motor_velocity": samples.motor_velocity.copy(),
            "q": estimate.q,
            "q_dot": estimate.q_dot,
            "phi": estimate.phi,
            "side": estimate.side,
            "tau_M": estimate.tau_M,
            "threshold": estimate.threshold,
            "reference": decision.reference.copy(),
        }
        self._rows.append(row)
        deciding = rig.robot.configuration.estimator.residual.name
        self._residuals.append({deciding: estimate.residual, **estimate.beside})

    def recording(self) -> Recording:
        """Everything since the first call."""
        return Recording(
            configuration=self._rig.robot.configuration,
            delay_s=self._rig.tick.estimator.delay_s,
            residuals=_columns(self._residuals),
            **_columns(self._rows),
        )


def _columns(rows: list[dict[str, Any]]) -> dict[str, NDArray[Any]]:
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}
