"""The estimator's chain for one tick: samples in, `Estimate` out. The arithmetic is in `kernel`.

Samples are first brought to one common instant (`link_velocity`); everything after that, from the
motor position to the residual, belongs to that instant, `Estimator.delay_s` before the samples.

A joint whose sample is missing does not blind the others. They take its link to go on as it did,
and its own interval lasts until its next sample comes, so that no impulse is lost: what the bridge
was wrong by is in the next increment.
"""

import math
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from arrays import Vector
from errors import ModelError
from estimator import memory
from estimator.contact import Contact, Touch, dead_band, touched_link
from estimator.dynamics import Dynamics
from estimator.estimate import Estimate, Flag
from estimator.gap import Gap
from estimator.kernel import Kernel
from estimator.link_velocity import DELAY_PERIODS
from estimator.model import Model
from estimator.residual import weights
from estimator.settings import EstimatorSettings
from estimator.thresholds import ThresholdRaise, Thresholds
from estimator.transmission import Transmission, resting

_INPUTS = ("current", "link_position", "motor_velocity")
_FLAGS = tuple(Flag(i) for i in range(2 * int(Flag.RAISED)))  # making one costs a microsecond
INVALID = int(Flag.INVALID)
_ROTORS = (
    *("theta", "sigma", "streak", "side", "gap"),
    *("q", "slipped", "slipped_most", "rested_at", "rested_s"),
)


class Estimator:
    """The whole chain from samples to contact for one arm.

    Raises ModelError if the parts do not fit each other.
    """

    def __init__(
        self,
        model: Model,
        transmission: Transmission,
        settings: EstimatorSettings,
        thresholds: Thresholds,
        period_s: float,
    ) -> None:
        n = model.n
        if transmission.joints != model.names:
            raise ModelError(f"transmission of {transmission.joints}, model of {model.names}")
        if settings.sign_width != transmission.sign_width:
            raise ModelError(
                f"sign_width {settings.sign_width} and {transmission.sign_width} differ"
            )
        if thresholds.contact.shape != (n,):
            raise ModelError(f"thresholds for {thresholds.contact.size} joints, the arm has {n}")
        self.model = model
        self.transmission = transmission
        self.settings = settings
        self.period_s = period_s
        self.variants = (settings.residual, *settings.beside)
        s, back = settings, DELAY_PERIODS[settings.link_velocity] * period_s
        self.delay_s = back + s.link_position_delay_ms / 1000
        """Age of the estimate when its samples arrive [s]; the residual adds ln 2 / K."""
        delays = (s.current_delay_ms, s.motor_velocity_delay_ms, s.motor_position_delay_ms)
        current, velocity, position = (self.delay_s - delay / 1000 for delay in delays)
        always, engaged, corrected = weights(self.variants, s.gain, period_s)
        self._measured = settings.motor_position == "measured"
        self._kernel = kernel = Kernel(
            transmission,
            settings,
            thresholds,
            Dynamics(model.bodies(), model.down),
            Gap(transmission, settings.gap, self._measured),
            period_s=period_s,
            ages=(back, current, velocity, position),
            always=always,
            engaged=engaged,
            corrected=corrected,
        )
        self._samples, self._came = np.asarray(kernel.samples), np.asarray(kernel.came)
        self.residuals, self._sensing = np.asarray(kernel.residual), np.asarray(kernel.sensing)
        self._shown, self._side = np.asarray(kernel.shown), np.asarray(kernel.rotors.side)
        self.detector = Touch(model.names, thresholds, kernel, settings.debounce)
        self._thresholds = thresholds
        self._threshold_raise = ThresholdRaise(transmission, settings, thresholds.contact)
        self._beside = tuple(enumerate((v.name for v in settings.beside), start=1))
        self._shape = (n,)
        self.elapsed = 0.0
        self._state = self._views()
        for i in range(n):
            kernel.still(i, 0.0)
        self._last = self._estimate((), Flag.STARTING)

    def _views(self) -> dict[str, SimpleNamespace]:
        """The kernel's arrays by the part of the estimator that they are the memory of."""
        k = self._kernel
        shown = {name: getattr(k, name) for name in ("q", "q_dot", "tau_M", "threshold")}
        samples = {name: getattr(k, name) for name in ("count", "interval", "interval_before")}
        parts = {
            "estimator": {"since": k.since, "going": k.going, "aligned": k.aligned, **shown},
            "alignment": {"history": k.history, **samples},
            "interval": {"ends": k.ends},
            "motor_position": {name: getattr(k.rotors, name) for name in _ROTORS},
            "stiction": {"ends": k.stiction},
            "residual": {"values": k.residual},
            "detector": {"raised": k.raised, "streak": k.streak, "waited": k.waited},
        }
        return {
            part: SimpleNamespace(**{name: np.asarray(x) for name, x in views.items()})
            for part, views in parts.items()
        }

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
        """Take the samples of one tick, each of shape (n,) [A, rad, rad/s, rad at the link].

        dt: true interval since the tick before [s], by default the period. time_s: only for the
        contacts' time; by default the sum of all dt. fresh: joints (n,) of which there is a sample
        in this tick, by default all; values of the others are not used.

        Samples that are not finite are not used; finite ones of which the arithmetic makes what is
        not finite start everything anew. Either way the last good values come back, flagged
        INVALID. Raises ModelError for arrays of another shape.
        """
        dt = self.period_s if dt is None else dt
        for name, values in zip(_INPUTS, (current, link_position, motor_velocity), strict=True):
            self._check_shape(name, values)
        samples = self._samples
        samples[0], samples[1], samples[3] = current, motor_velocity, link_position
        if self._measured:
            if motor_position is not None:
                self._check_shape("motor_position", motor_position)
            samples[2] = np.nan if motor_position is None else motor_position
        self._came[:] = True if fresh is None else fresh
        self.elapsed += dt if 0.0 < dt < math.inf else self.period_s
        flags = self._kernel.step(dt)
        if flags & INVALID:
            nothing = np.zeros(self._shape, dtype=np.bool_)
            return replace(self._last, contacts=(), flags=Flag.INVALID, sensing=nothing)
        contacts = self.detector.begun(self.elapsed if time_s is None else time_s)
        self._last = self._estimate(contacts, _FLAGS[flags])
        return self._last

    def levels_at(self, speed: Vector) -> Vector:
        """Contact levels (n,) [Nm] that would be in force at motor speeds (n,) [rad/s], with what
        is known now of friction and gaps. Changes nothing."""
        low, high = self._state["stiction"].ends
        side = self._state["motor_position"].side
        hidden = self._threshold_raise.at(resting(speed), 0.5 * (high - low), side)
        t = self._thresholds
        levels: Vector = t.contact + hidden + t.per_speed * np.abs(speed)
        return levels

    def reset(self) -> None:
        """Forget external torque and contacts: r = 0. Positions and velocities are kept, so that
        nothing jumps."""
        for i in range(self.model.n):
            self._kernel.reset(i)

    def restart(self, joints: NDArray[np.bool_] | None = None) -> None:
        """Forget all samples of these joints (n,), by default of all, and with them where their
        rotors are in their gaps."""
        for i in range(self.model.n):
            if joints is None or joints[i]:
                self._kernel.restart(i)

    def memory(self) -> dict[str, Any]:
        """The complete internal state, fit for JSON; `restore` continues bit-identically."""
        parts = {name: memory.dump(part, list(vars(part))) for name, part in self._state.items()}
        parts["estimator"]["elapsed"] = self.elapsed
        return parts

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from `memory()`. Raises ModelError if it belongs to another arm."""
        if set(state) != set(self._state):
            raise ModelError(f"memory of an estimator: {sorted(state)}")
        for name, part in self._state.items():
            values = state[name]
            own = {"elapsed": self.elapsed} if name == "estimator" else {}
            read = SimpleNamespace(**vars(part), **own)
            memory.load(read, list(vars(read)), values, what=name)
            if own:
                self.elapsed = read.elapsed
        self._kernel.resume()
        self._last = self._estimate((), Flag(0))

    def _check_shape(self, name: str, values: Vector) -> None:
        """Raise ModelError for another shape: numpy would stretch one number over all joints."""
        if getattr(values, "shape", None) != self._shape:
            given = getattr(values, "shape", type(values).__name__)
            raise ModelError(f"{name} is {given}; it must be an array of shape {self._shape}")

    def _estimate(self, contacts: tuple[Contact, ...], flags: Flag) -> Estimate:
        residuals, side = self.residuals.copy(), self._side.astype(np.int8)
        q, q_dot, theta, phi, phi_sigma, tau_M, threshold, thresholded = self._shown.copy()
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
            contacts=contacts,
            touched_link=self._touched_link(residuals[0], threshold)
            if np.count_nonzero(thresholded)
            else "",
            flags=flags,
            sensing=self._sensing.astype(np.bool_),
        )

    def _touched_link(self, residual: Vector, threshold: Vector) -> str:
        # A residual that stiction may explain near rest is no sign of a touch.
        contact = self._thresholds.contact
        link = touched_link(dead_band(residual, threshold - contact), contact)
        return "" if link is None else self.model.names[link]
