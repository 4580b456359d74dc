"""Recognition of a load from the residuals: a point mass at the hand that the model does not
include.

A mass m at c in the hand's frame loads the joints, in every pose and at every moment, by

    tau = m (a(q) + B(q) c)            a, B: `Model.payload_torques`, gravity less acceleration

so the residuals of some seconds of motion are linear in m and m c. A load is recognised if one such
pair explains the residuals of all joints, if each second by itself shows the same mass, and if the
joints that carry it have moved. The force of a hand changes in size or direction; only a constant
pull, straight down at the hand, is indistinguishable from a load while it lasts. So a load is
confirmed only if the mass stays the same, within a closer tolerance, for two more seconds of motion
and twice the travel; the mass is then that of these last seconds, without those of the pick-up.

Ticks without motion do not count, as friction may hide anything then. Means are taken over blocks
of a quarter of a second of motion, or more where it is slow: a tick adds some vectors, and only the
last one of a block fits four unknowns. In parallel the errors of the model without contact are
tracked, as an apparent load and gain errors of the motors, and subtracted; they come from motion
older than the blocks in use, so that a load is not taken for an error while it is recognised.

Nothing here changes a threshold or the model. Time is counted in ticks; no I/O.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from estimator.contact import dead_band
from estimator.model import Model
from estimator.payload import HEAVIEST_KG, Payload

_BLOCK_S: Final = 0.25
# Blocks of motion in which a load is sought, seven seconds; blocks of each part that must show the
# same mass by itself; and consecutive blocks for which all that must hold.
_BLOCKS, _PART, _AGAIN = 28, 4, 4
# Standard deviation of a block's mean, over the level in force: of a moving joint, and of one at
# rest, where friction may hide most of it.
_NOISE, _AT_REST = 0.4, 1.0
_MOVES: Final = 0.012  # [rad/s]
_TRAVEL: Final = 0.25  # [rad] that the joints which clearly carry it must have moved, in total
_LEAST_KG, _SURE = 0.08, 5.0  # least mass, and least ratio of it to its standard deviation
# Offset of the load from the tool point along each axis [m]: prior standard deviation, and maximum.
_PLACE, _AT_HAND = 0.03, 0.2
# Squared residuals that the fit may leave: this share of all; and the larger of the second share
# and that of so many standard deviations.
_LEFT, _LEFT_CLEAR, _LEFT_NOISE = 0.3, 0.03, 0.6
# Spread of the parts' masses, root mean square, as a share of the mass, or [kg]; and how many times
# that a part with as much information as the others may deviate.
_SPREAD, _SPREAD_KG, _WORST = 0.05, 0.015, 2.0
# Share of its mass that must show even without subtracting the errors below.
_SHOWS: Final = 0.5
# Model errors, as an apparent load and a relative error of each motor's torque: blocks after which
# they fade, weight of a block, as these are alike, and prior standard deviations [kg, kg m].
_FADES, _ALIKE, _ERRORS, _GAIN = 480.0, 0.3, (0.05, 0.005, 0.005, 0.005), 0.03
# A load is confirmed by so many more consecutive blocks that show it, with at most this spread, and
# this travel of the joints that carry it [rad].
_CONFIRMS, _ALIKE_SHARE, _CONFIRMED_TRAVEL = 8, 0.04, 0.5
# A recognised load is forgotten if it has not explained the detected contact for so long [s], or if
# at least so many blocks since then clearly show a mass that is off by this share: below the levels
# no contact is detected.
_FORGOTTEN_S: Final = 0.5
_SINCE, _ANOTHER = 8, 0.5


def weighed(model: Model, mean: Matrix, gravity: Vector) -> tuple[Matrix, Vector, Vector]:
    """Regressor of a load (n, 4), by mass at the tool point and by mass times offset from it;
    regressor of a 100 % gain error of each motor (n,); residuals (n,); all in standard deviations
    of the residuals. mean: of q, |q_dot|, residual and threshold (4, n); gravity: less acceleration
    (3,) [m/s2]."""
    by_mass, by_place = model.payload_torques(mean[0], gravity)
    columns = np.column_stack((by_mass + by_place @ model.tool_place, by_place))
    weight = 1.0 / (np.where(mean[1] > _MOVES, _NOISE, _AT_REST) * mean[3])
    return columns * weight[:, np.newaxis], weight * model.gravity(mean[0]), weight * mean[2]


def fitted_load(x: Matrix, y: Vector) -> Vector:
    """Mass, and mass times offset from the tool point (4,) [kg, kg m], fitted to x (rows, 4) and y
    (rows,), both from `weighed`, with a prior that places it near the tool point."""
    information, evidence = x.T @ x, x.T @ y
    # The prior in kg m depends on the mass.
    mass = _LEAST_KG
    fitted: np.ndarray = np.zeros(4)
    for _ in range(3):
        expected = np.array([0.0, *[(_PLACE * max(mass, _LEAST_KG)) ** -2.0] * 3])
        fitted = np.linalg.solve(information + np.diag(expected + 1e-9), evidence)
        mass = float(fitted[0])
    return fitted


@dataclass(frozen=True, slots=True)
class _Fit:
    """Load that the last blocks show, spread of their masses over it, and travel of the joints that
    carry it [rad]."""

    load: Payload
    spread: float
    travel: float

    @property
    def confirms(self) -> bool:
        """True if spread and travel are those of a confirmed load."""
        alike = self.spread <= max(_ALIKE_SHARE, _SPREAD_KG / self.load.mass)
        return alike and self.travel >= _CONFIRMED_TRAVEL


class Recognition:
    """Load recognition for one arm: `found` is the recognised load, None without one; `confirmed`
    is set if it has stayed the same since."""

    def __init__(self, model: Model, period_s: float) -> None:
        n = self._n = model.n
        self.found: Payload | None = None
        self.confirmed = False
        self._model, self._period_s = model, period_s
        self._ticks = round(_BLOCK_S / period_s)
        self._forgotten_ticks = round(_FORGOTTEN_S / period_s)
        # Sums over the present block: q, |q_dot|, residual, threshold.
        self._sum = np.zeros((4, n))
        self._count = self._unexplained = self._again = 0
        self._touched = False
        self._before: np.ndarray | None = None  # tool velocity at the end of the last block
        # Last blocks of motion, newest last: regressors and residuals, in standard deviations.
        self._columns = np.zeros((_BLOCKS, n, 4))
        self._motors, self._shown, self._travel = np.zeros((3, _BLOCKS, n))
        # Joints that moved in them, and those that moved untouched, which show the model's errors.
        self._moves, self._free = np.zeros((2, _BLOCKS, n), dtype=np.bool_)
        self._filled = self._since = 0  # the latter since a load was found
        # Levels before a load was found: they are higher since, and would hide its end.
        self._level_before = np.full(n, np.inf)
        self._prior = np.diag(np.array([*_ERRORS, *[_GAIN] * n]) ** -2.0)
        self._information, self._evidence = np.zeros((4 + n, 4 + n)), np.zeros(4 + n)

    def begin(self) -> None:
        """Restart with another model: its tracked errors may have included a load."""
        self._information[:], self._evidence[:] = 0.0, 0.0
        self.forget()

    def forget(self) -> None:
        """Forget the load, or the contact, because another begins. The model's errors are kept."""
        self.found, self.confirmed = None, False
        self._filled = self._again = self._unexplained = 0
        self.pause()

    def pause(self) -> None:
        """Discard the present block, in which something is unknown."""
        self._sum[:] = 0.0
        self._count, self._touched, self._before = 0, False, None

    def left(self, q: Vector, residual: Vector, threshold: Vector) -> Vector:
        """Thresholded residual (n,) [Nm] at q that the recognised load does not explain."""
        if self.found is None:
            return dead_band(residual, threshold)
        by_mass, by_place = self._model.payload_torques(q, self._model.down)
        torque = self.found.mass * (by_mass + by_place @ self.found.com)
        return dead_band(residual - torque, threshold)

    def step(
        self, q: Vector, q_dot: Vector, residual: Vector, threshold: Vector, *, touched: bool
    ) -> None:
        """Process the estimate of one tick, (n,) each; touched: a residual is beyond its
        threshold."""
        self._touched = self._touched or touched
        speed = np.abs(q_dot)
        if speed.max() > _MOVES:
            total = self._sum
            total[0] += q
            total[1] += speed
            total[2] += residual
            total[3] += threshold
            self._count += 1
        if self.found is not None:
            lost = self.left(q, residual, threshold).any()
            self._unexplained = self._unexplained + 1 if lost else 0
            if self._unexplained >= self._forgotten_ticks:
                self.forget()
        if self._count >= self._ticks and self._sum[1].max() * self._period_s > _TRAVEL / _BLOCKS:
            self._end_block(q, q_dot)

    def _end_block(self, q: Vector, q_dot: Vector) -> None:
        """Add the present block to the last ones, and look for a load in them."""
        touched, count = self._touched, self._count
        mean = self._sum / count
        velocity: np.ndarray = self._model.tool_jacobian(q) @ q_dot
        before = velocity if self._before is None else self._before
        travel = count * self._period_s * mean[1]
        self.pause()
        if not np.isfinite(mean).all():
            return  # else it would stay in the tracked model errors
        if self.found is not None:
            mean[3] = np.minimum(mean[3], self._level_before)
        elif np.isfinite(self._level_before).all():
            self._level_before += (mean[3] - self._level_before) / _BLOCKS
        else:
            self._level_before[:] = mean[3]
        self._before = velocity
        acceleration = (velocity - before) / (count * self._period_s)
        gravity = self._model.down - acceleration
        columns, motors, shown = weighed(self._model, mean, gravity)
        if self._filled == _BLOCKS and self.found is None:
            self._take_errors(self._free[0])
        moves = mean[1] > _MOVES
        for kept, new in (
            (self._columns, columns),
            (self._motors, motors),
            (self._shown, shown),
            (self._travel, travel),
            (self._moves, moves),
            (self._free, moves & (not touched)),
        ):
            kept[:-1] = kept[1:]
            kept[-1] = new
        self._filled = min(self._filled + 1, _BLOCKS)
        self._since = 0 if self.found is None else self._since + 1
        if self._filled == _BLOCKS:
            if self.found is not None and self._is_another(self.found):
                self.forget()
            elif not self.confirmed:
                self._judge(self._fit())

    def _is_another(self, found: Payload) -> bool:
        """True if the blocks since the recognition clearly show another mass there, or none."""
        if self._since < _SINCE:
            return False
        last = slice(-min(self._since, _BLOCKS), None)
        off_tool = np.asarray(found.com) - self._model.tool_place
        per_kg = self._columns[last] @ np.array([1.0, *off_tool]) * self._moves[last]
        known = float(np.sum(per_kg**2))
        mass = float(np.sum(per_kg * self._less_errors()[last])) / (known + 1e-12)
        off = abs(mass - found.mass)
        return off > _ANOTHER * found.mass and off * np.sqrt(known) > _SURE

    def _judge(self, fit: _Fit | None) -> None:
        """Count consecutive blocks that show a load, and then those that confirm it."""
        if self.found is None:
            self._again = self._again + 1 if fit else 0
            if fit and self._again >= _AGAIN:
                self.found, self._unexplained, self._again = fit.load, 0, 0
        else:
            self._again = self._again + 1 if fit and fit.confirms else 0
            if fit and self._again >= _CONFIRMS:
                self.found, self.confirmed = fit.load, True

    def _take_errors(self, free: NDArray[np.bool_]) -> None:
        """Add the oldest block to the tracked model errors, for the joints that moved untouched."""
        if not free.any():
            return
        moved = np.hstack((self._columns[0], np.diag(self._motors[0])))[free]
        self._information += _ALIKE * (moved.T @ moved) - self._information / _FADES
        self._evidence += _ALIKE * (moved.T @ self._shown[0, free]) - self._evidence / _FADES

    def _less_errors(self) -> Matrix:
        """Residuals of the last blocks (blocks, n), minus the model's errors."""
        errors = np.linalg.solve(self._prior + self._information, self._evidence)
        left: np.ndarray = self._shown - self._columns @ errors[:4] - self._motors * errors[4:]
        return left

    def _fit(self) -> _Fit | None:
        """Load that the last blocks show; None without one."""
        shown = self._less_errors()
        x = self._columns.reshape(-1, 4)
        y = shown.reshape(-1)
        power = float(y @ y)
        fitted = fitted_load(x, y)
        mass = float(fitted[0])
        if not _LEAST_KG < mass < HEAVIEST_KG:
            return None
        left = y - x @ fitted
        noise = max(_LEFT_NOISE**2 * len(y), _LEFT_CLEAR * power)
        if left @ left > min(_LEFT * power, noise):
            return None
        # Residual per kg at the fitted place, for the mass that each part shows by itself.
        per_kg = self._columns @ (fitted / mass)
        parts = _BLOCKS // _PART
        known = np.sum((per_kg**2).reshape(parts, -1), axis=1)
        off = np.sum((per_kg * shown).reshape(parts, -1), axis=1) / (known + 1e-12) - mass
        spread = float(np.sqrt(known @ off**2 / (known.sum() + 1e-12)))
        allowed = max(_SPREAD * mass, _SPREAD_KG)
        travel = float(np.sum(self._travel * (mass * np.abs(per_kg) > 1.0)))
        if (
            mass * np.sqrt(known.sum()) < _SURE
            or spread > allowed
            or np.max(np.abs(off) * np.sqrt(known / known.mean())) > _WORST * allowed
            or np.sum(per_kg * self._shown) < _SHOWS * mass * known.sum()
            or travel < _TRAVEL
        ):
            return None
        off_tool = fitted[1:] / mass
        if np.abs(off_tool).max() > _AT_HAND:
            return None
        load = Payload(mass=mass, com=(self._model.tool_place + off_tool).tolist())
        return _Fit(load, spread / mass, travel)
