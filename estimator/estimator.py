"""The estimation chain for one tick: samples in, `Estimate` out. The arithmetic is in `kernel`.

Samples are first aligned to one common instant (`link_velocity`); everything after that, from the
motor position to the residual, refers to that instant, `Estimator.delay_s` before the samples.

A missing sample of one joint does not disable the others: its link motion is extrapolated for them.
Its own interval lasts until its next sample, so that no impulse is lost: the error of the
extrapolation is corrected by the next increment.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from common.errors import ModelError
from estimator import memory
from estimator.contact import Contact
from estimator.dynamics import Dynamics
from estimator.estimate import Estimate, EstimateRows, Flag, LearnedFriction, SampleRows
from estimator.kernel import Kernel
from estimator.levels_at import levels_at
from estimator.model import Model
from estimator.payload import Payload
from estimator.rows import step_through
from estimator.settings import EstimatorSettings
from estimator.thresholds import Thresholds
from estimator.transmission import Transmission
from estimator.wrench import WIDTH

_FLAGS = tuple(Flag(i) for i in range(2 * max(Flag)))  # creating one takes a microsecond
_INVALID = int(Flag.INVALID)
# Rows of the kernel's output.
_SHOWN = (
    "q", "q_dot", "theta", "phi", "phi_sigma", "tau_M", "threshold", "thresholded", "level_share",
    "uncorrected",
)  # fmt: skip


class Estimator:
    """The complete chain from samples to contacts for one arm.

    Raises ModelError if the parts do not match.
    """

    def __init__(
        self,
        model: Model,
        transmission: Transmission,
        settings: EstimatorSettings,
        thresholds: Thresholds,
        period_s: float,
    ) -> None:
        if transmission.joints != model.names:
            raise ModelError(f"transmission of {transmission.joints}, but model of {model.names}")
        if settings.sign_width != transmission.sign_width:
            raise ModelError(
                f"sign_width {settings.sign_width} (settings) and "
                f"{transmission.sign_width} (transmission) differ"
            )
        self.model, self.transmission, self.settings = model, transmission, settings
        self.period_s, self.contact = period_s, thresholds.contact
        self.variants = (settings.residual, *settings.beside)
        dynamics = Dynamics(model.bodies(), model.down)
        self._kernel = k = Kernel(
            dynamics, transmission, settings, thresholds, period_s, model.place(settings.force_at)
        )
        np.asarray(k.lower)[:], np.asarray(k.upper)[:] = model.lower, model.upper
        self.delay_s: float = k.alignment.delay_s
        """Age of the estimate when its samples arrive [s]; the residual adds ln 2 / K."""
        self.detector = k.detector
        self._measured = settings.motor_position == "measured"
        self._samples, self._arrived = np.asarray(k.alignment.samples), np.asarray(k.arrived)
        self._shown, self._side = np.asarray(k.shown), np.asarray(k.motor_position.side)
        self._wrench = np.asarray(k.wrench.shown)
        self.residuals: Matrix = np.asarray(k.residual.corrected)
        """of all `variants` (variants, n) [Nm]; a live view, not a copy"""
        self.given_up, self.met = np.asarray(k.adaptation.given_up), np.asarray(k.doubt.met)
        self.interrupted = np.asarray(k.doubt.interrupted)
        """times that learned friction was discarded, that motion at one place disagreed again, and
        that the place interrupted the arm (n,); live views, not copies"""
        self._sensing = np.asarray(k.sensing).view(np.bool_)
        self._beside = tuple(enumerate((v.name for v in settings.beside), start=1))
        self._shape = (model.n,)
        self._link_names = (*model.names, "")
        self._last = self._estimate((), Flag.STARTING)

    def step(
        self,
        current: Vector,
        link_position: Vector,
        motor_velocity: Vector,
        motor_position: Vector | None = None,
        dt: float | None = None,
        *,
        time_s: float | None = None,
        fresh: NDArray[np.bool_] | None = None,
    ) -> Estimate:
        """Process the samples of one tick, each of shape (n,) [A, rad, rad/s, rad at the link].

        dt: true interval since the previous tick [s], by default the period. time_s: only for the
        time of contacts; by default the sum of all dt. fresh: joints (n,) with a sample in this
        tick, by default all; values of the others are ignored.

        Samples that are not finite are not used; finite ones that overflow in the arithmetic
        restart everything. In both cases the last valid values are returned, flagged INVALID.
        Raises ModelError for arrays of another shape.
        """
        dt = self.period_s if dt is None else dt
        self._check_shape("current", current)
        self._check_shape("link_position", link_position)
        self._check_shape("motor_velocity", motor_velocity)
        samples = self._samples
        samples[0], samples[1], samples[3] = current, motor_velocity, link_position
        if self._measured:
            if motor_position is not None:
                self._check_shape("motor_position", motor_position)
            samples[2] = np.nan if motor_position is None else motor_position
        if fresh is not None:
            self._check_shape("fresh", fresh)
        self._arrived[:] = True if fresh is None else fresh
        flags = self._kernel.step(dt)
        if flags & _INVALID:
            nothing = np.zeros(self._shape, dtype=np.bool_)
            return replace(self._last, contacts=(), flags=Flag.INVALID, sensing=nothing)
        contacts: tuple[Contact, ...] = ()
        if self._kernel.begun:
            now_s = self._kernel.elapsed_s if time_s is None else time_s
            contacts = self.detector.begun(self.residuals[0], self._side, now_s)
        self._last = self._estimate(contacts, _FLAGS[flags])
        return self._last

    def run(self, samples: SampleRows, resets: Collection[int] = ()) -> EstimateRows:
        """Process many ticks, as `step` does one by one, with a `reset` after each tick in
        `resets`. Raises ModelError for arrays of another shape."""
        N, n = samples.current.shape[0], self.model.n
        rows = np.zeros((N, 4, n))
        arrived, after = np.zeros((N, n), dtype=np.int64), np.zeros(N, dtype=np.int64)
        for name in ("current", "link_position", "motor_velocity", "motor_position", "fresh"):
            self._check_shape(name, getattr(samples, name), (N, n))
        self._check_shape("interval_s", samples.interval_s, (N,))
        rows[:, 0], rows[:, 1], rows[:, 3] = (
            samples.current,
            samples.motor_velocity,
            samples.link_position,
        )
        if self._measured:
            rows[:, 2] = samples.motor_position
        arrived[:], after[list(resets)] = samples.fresh, 1
        shown, residuals = (
            np.empty((N + 1, len(_SHOWN), n)),
            np.empty((N + 1, len(self.variants), n)),
        )
        side, words = np.empty((N + 1, n), dtype=np.int8), np.empty((N + 1, 2), dtype=np.int64)
        wrench = np.empty((N + 1, WIDTH))
        last, no_link = self._last, len(self.model.names)
        shown[0], side[0] = [getattr(last, name) for name in _SHOWN], last.side
        wrench[0] = last.wrench
        residuals[0] = [last.residual, *(last.beside[name] for _, name in self._beside)]
        link = self._link_names.index(last.touched_link)
        words[0] = last.flags, -1 if link == no_link else link
        step_through(
            self._kernel, rows, arrived, samples.interval_s, after, shown, residuals, side, wrench,
            words,
        )  # fmt: skip
        self._last = self._estimate_of(
            shown[N], residuals[N], side[N], wrench[N], words[N].tolist()
        )
        return EstimateRows(
            **{name: shown[1:, row] for row, name in enumerate(_SHOWN)},
            side=side[1:],
            residual=residuals[1:, 0],
            beside={name: residuals[1:, row] for row, name in self._beside},
            touched_link=words[1:, 1],
            flags=words[1:, 0],
            wrench=wrench[1:],
        )

    def levels_at(self, speed: Vector) -> Vector:
        """Contact levels (n,) [Nm] that would be in force at motor speeds (n,) [rad/s], with the
        present knowledge of friction and gaps. Changes nothing."""
        return levels_at(self._kernel, np.abs(speed))

    def reset(self) -> None:
        """Forget external torque and contacts: r = 0. Positions and velocities are kept, so that
        nothing jumps."""
        for i in range(self.model.n):
            self._kernel.reset(i)

    def restart(self) -> None:
        """Forget all samples, and with them the rotors' positions in their gaps."""
        for i in range(self.model.n):
            self._kernel.restart(i)

    def carry(self, payload: Payload | None) -> None:
        """Include the payload at the hand in the model from the next tick on; None removes it. The
        residuals continue from their values, and follow the external torque under the new model as
        ever: r_dot = K (tau_ext - r)."""
        row = np.zeros(4)
        if payload is not None:
            row[0], row[1:] = (
                payload.mass,
                self.model.in_joint(np.array(payload.com, dtype=np.float64)),
            )
        kernel = self._kernel
        kernel.torques.carry(row, kernel.alignment.aligned, kernel.going)

    def freeze_learning(self, frozen: bool) -> None:
        """Suspend learning from the next tick on, at the stated levels, or resume it."""
        self._kernel.adaptation.frozen = int(frozen)

    def place(self, i: int) -> float:
        """Centre of the place at which joint i was last interrupted [rad]."""
        doubt = self._kernel.doubt
        return 0.5 * float(doubt.low[i] + doubt.high[i])

    def learned(self) -> LearnedFriction:
        """Learned friction of each joint."""
        learning = self._kernel.learning
        viscous, coulomb, load = np.asarray(learning.shares)[:, 1:].T
        left = np.array(learning.coulomb_left)
        return LearnedFriction(1.0 - coulomb, 1.0 - viscous, 0.0 - load, left)

    def memory(self) -> dict[str, Any]:
        """Complete internal state, fit for JSON; `restore` continues bit-identically."""
        return memory.dump(self._kernel)

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from `memory()`. Raises ModelError if it does not fit this arm."""
        memory.load(self._kernel, state)
        self._last = self._estimate((), Flag(0))

    def _check_shape(
        self, name: str, values: NDArray[Any], shape: tuple[int, ...] | None = None
    ) -> None:
        """Raise ModelError for another shape than this, by default (n,): numpy would broadcast one
        number over all joints, and compiled code would read past the end of a short array."""
        wanted = self._shape if shape is None else shape
        if getattr(values, "shape", None) != wanted:
            given = getattr(values, "shape", type(values).__name__)
            raise ModelError(f"{name} is {given}; it must be an array of shape {wanted}")

    def _estimate(self, contacts: tuple[Contact, ...], flags: Flag) -> Estimate:
        return self._estimate_of(
            self._shown.copy(),
            self.residuals.copy(),
            self._side.copy(),
            self._wrench.copy(),
            (flags, self._kernel.touched_link),
            contacts,
        )

    def _estimate_of(
        self,
        shown: Matrix,
        residuals: Matrix,
        side: NDArray[np.int8],
        wrench: Vector,
        words: Sequence[int],
        contacts: tuple[Contact, ...] = (),
    ) -> Estimate:
        """Estimate of one tick; shown (10, n), residuals (variants, n), words: flags, touched
        link."""
        flags, link = words
        q, q_dot, theta, phi, phi_sigma, tau_M, threshold, thresholded, level_share, raw = shown
        return Estimate(
            q=q,
            q_dot=q_dot,
            theta=theta,
            phi=phi,
            phi_sigma=phi_sigma,
            side=side,
            tau_M=tau_M,
            residual=residuals[0],
            beside={name: residuals[row] for row, name in self._beside},
            threshold=threshold,
            thresholded=thresholded,
            level_share=level_share,
            uncorrected=raw,
            contacts=contacts,
            touched_link=self._link_names[link],
            flags=_FLAGS[flags],
            wrench=wrench,
            sensing=self._sensing.copy(),
        )
