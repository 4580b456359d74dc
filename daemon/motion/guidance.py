"""Guidance of an arm that is led by hand: the guide that its configured axes define, if any."""

import numpy as np

from common.arrays import Vector
from common.errors import ModelError
from daemon.motion.guide import Guide
from daemon.motion.hand_witness import agreed
from daemon.protocol.guide import AXES, BASE, TOOL, GuideAxes
from estimator.dynamics import Place
from estimator.model import Model


def guide_place(model: Model, axes: GuideAxes) -> Place:
    """Frame of a guide. Raises ModelError for an unknown one."""
    try:
        return model.place("" if axes.frame in (TOOL, BASE) else axes.frame)
    except ModelError as error:
        raise ModelError(f"{error}; or it is {TOOL} or {BASE}") from error


class Guidance:
    """Guide of one arm, changed between two ticks; vectors of shape (n,)."""

    def __init__(self, model: Model | None, velocity: Vector, rate: float) -> None:
        """model: None if no guide is permitted; velocity: largest of each joint [rad/s]; rate: of
        the spring [1/s]."""
        self.axes, self.words = GuideAxes(), ""
        """Axes of the guide, and their description; empty without a guide"""
        self.sure = True
        """False if sensing is doubtful: the guide then restarts, without its spring"""
        self.led = True
        """False without a witnessed hand: velocities fade, and no joint turns for another"""
        self.residual: Vector | None = None
        """Residual (n,) [Nm] that may withstand the spring; None: the thresholded one"""
        self._model, self._velocity, self._rate = model, velocity, rate
        self._guide: Guide | None = None
        self._kinds: list[int] = []

    def change(self, axes: GuideAxes) -> None:
        """Replace the guide; the new one begins where the arm is led next. Raises ModelError for an
        unknown frame, or if no guide is permitted."""
        guide = None
        if axes.guides:
            if self._model is None:
                raise ModelError("no guide while the signs of the links are not checked")
            self._kinds = axes.kinds()
            place, kinds = guide_place(self._model, axes), np.array(self._kinds)
            how = {"turned": axes.frame != BASE, "redundant": axes.redundant == "free"}
            guide = Guide(self._model, place, self._velocity, self._rate, kinds, **how)
        self.axes, self._guide = axes, guide
        self.words = str(axes) if guide else ""

    @property
    def guides(self) -> bool:
        """True if there is a guide."""
        return self._guide is not None

    @property
    def damped(self) -> str:
        """Stiff axes that are damped since a force withstood their spring; empty without any."""
        guide = self._guide
        axes = zip(AXES, self._kinds, guide.spring.kind, strict=True) if guide else ()
        return " ".join(axis for axis, asked, kind in axes if kind != asked)

    def begin(self, q: Vector) -> None:
        """Begin the guide at q [rad], unless it has begun."""
        if self._guide is not None:
            self._guide.begin(q)

    def forget(self) -> None:
        """Discard the guide's pose: the arm moves by itself."""
        if self._guide is not None:
            self._guide.forget()

    def step(
        self, q: Vector, moved: Vector, sent: Vector, before: Vector, asked: Vector,
        share: Vector, gain: Vector, room: Vector, push: Vector, dt: float,
    ) -> Vector:  # fmt: skip
        """Guided velocity [rad/s] at q [rad]: from the velocity `before` of the previous tick by a
        share of the difference to `asked`, with gains K_a; `moved` are the velocities of the
        motors, `sent` their setpoints, room (2, n) the travel left down and up [rad], push (n,) the
        thresholded residual [Nm]."""
        assert self._guide is not None
        if not self.sure:
            self._guide.forget()
        if not self.led:
            fades = before - share * before
            return agreed(fades, fades + share * asked)
        most, out = np.maximum(self._rate * room, 0.0), np.empty_like(asked)
        residual = push if self.residual is None else self.residual
        hand = bool(push.any())
        self._guide.step(q, moved, sent, before, asked, share, gain, most, residual, hand, dt, out)
        return out
