"""Recognition of a load in the residuals: a point mass at the hand that the model does not count.

A mass m at c in the hand's frame puts on the joints, in every pose and at every moment,

    tau = m (a(q) + B(q) c)            a, B: `Model.payload_torques`, gravity less acceleration

so the residuals of some seconds in motion are linear in m and m c. A load is recognised where one
such pair explains what all joints show, where each second shows the same mass by itself, and where
the joints that carry it have moved. The force of a hand changes, in size or direction. Only a pull
of constant force, straight down, at the hand, for as long as that cannot be distinguished from a
load. So it is confirmed only where the mass stayed the same, more closely, for two more seconds of
motion and twice the way; the mass is then that of these last seconds, without those of the pick-up.

Ticks in which no joint moves do not count, as friction may hide anything then. Means are taken over
a quarter of a second of motion, or more where it is slow: a tick adds some vectors, and only the
last one of each makes a fit of four unknowns. Beside it, the model's errors without contact, as an
apparent load and gains of the motors, are tracked and subtracted; from motion older than the blocks
in use, so that a load is not taken for an error while it is being recognised.

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
# Blocks in motion that a load is found in, seven seconds; of each part that by itself must show the
# same mass; and in a row in which all is so.
_BLOCKS, _PART, _AGAIN = 28, 4, 4
# Standard deviation of the mean of a block, of the level in force: of a joint that moves, and of
# one that stands, where friction may hide most of it.
_NOISE, _AT_REST = 0.4, 1.0
_MOVES: Final = 0.012  # [rad/s]
_WAY: Final = 0.25  # [rad] that joints which clearly carry it must have moved, together
_LEAST_KG, _SURE = 0.08, 5.0  # mass, and that over its standard deviation
# Deviation of the place from the tool point along each axis [m]: expected, and at most.
_PLACE, _AT_HAND = 0.03, 0.2
# Share of the residuals that the fit may leave: at most; and where it is more than so many standard
# deviations.
_LEFT, _LEFT_CLEAR, _LEFT_NOISE = 0.3, 0.03, 0.6
# Deviation of the parts from the mass, root mean square: of the mass, or [kg]; and at most, of a
# part with as much information on it as the others.
_SPREAD, _SPREAD_KG, _WORST = 0.05, 0.015, 2.0
# Share of its mass that must show before the errors below are subtracted.
_SHOWS: Final = 0.5
# The load that the model's errors look like, and the share by which each motor's torque is off:
# fade over so many blocks, weigh so much less, as they are alike, and are expected to be so much
# [kg, kg m].
_FADES, _ALIKE, _ERRORS, _GAIN = 480.0, 0.3, (0.05, 0.005, 0.005, 0.005), 0.03
# It is confirmed where so many more blocks in a row show it, with parts as much alike as this, and
# joints that carry it having moved so far [rad].
_CONFIRMS, _ALIKE_SHARE, _CONFIRMED_WAY = 8, 0.04, 0.5
# A recognised load is forgotten when it did not explain the detected contact for so long [s], or
# when the last blocks, so many or more since then, clearly show a mass that is off by this share:
# below the levels no contact is detected.
_FORGOTTEN_S: Final = 0.5
_SINCE, _ANOTHER = 8, 0.5


def weighed(model: Model, mean: Matrix, gravity: Vector) -> tuple[Matrix, Vector, Vector]:
    """Columns of a load (n, 4), by mass at the tool point and by mass times distance from it, those
    of motors with twice the believed torque (n,), and the residuals (n,), all over the standard
    deviation of each; mean of q, |q_dot|, residual and threshold (4, n), gravity less acceleration
    (3,) [m/s2]."""
    by_mass, by_place = model.payload_torques(mean[0], gravity)
    columns = np.column_stack((by_mass + by_place @ model.tool_place, by_place))
    weight = 1.0 / (np.where(mean[1] > _MOVES, _NOISE, _AT_REST) * mean[3])
    return columns * weight[:, np.newaxis], weight * model.gravity(mean[0]), weight * mean[2]


def fitted_load(x: Matrix, y: Vector) -> Vector:
    """Mass, and mass times distance from the tool point (4,) [kg, kg m], that x (rows, 4) shows as
    y (rows,), both `weighed`. A place near the tool point is expected."""
    information, evidence = x.T @ x, x.T @ y
    # How near in kg m depends on the mass.
    mass = _LEAST_KG
    fitted: np.ndarray = np.zeros(4)
    for _ in range(3):
        expected = np.array([0.0, *[(_PLACE * max(mass, _LEAST_KG)) ** -2.0] * 3])
        fitted = np.linalg.solve(information + np.diag(expected + 1e-9), evidence)
        mass = float(fitted[0])
    return fitted


@dataclass(frozen=True, slots=True)
class _Fit:
    """Load that the last blocks show; spread of their masses over it, and way of the joints that
    carry it [rad]."""

    load: Payload
    spread: float
    way: float

    @property
    def confirms(self) -> bool:
        """True if it is as much alike, over as much motion, as a load that is confirmed."""
        alike = self.spread <= max(_ALIKE_SHARE, _SPREAD_KG / self.load.mass)
        return alike and self.way >= _CONFIRMED_WAY


class Recognition:
    """Recognition for one arm; `found` is the load that was recognised, None without one, and
    `confirmed` if it stayed the same since."""

    def __init__(self, model: Model, period_s: float) -> None:
        n = self._n = model.n
        self.found: Payload | None = None
        self.confirmed = False
        self._model, self._period_s = model, period_s
        self._ticks = round(_BLOCK_S / period_s)
        self._patience = round(_FORGOTTEN_S / period_s)
        # Sums over the block of now: q, |q_dot|, residual, threshold.
        self._sum = np.zeros((4, n))
        self._count = self._unexplained = self._again = 0
        self._touched = False
        self._before: np.ndarray | None = None  # velocity of the tool at the end of the last block
        # Of the last blocks in motion, the newest last: columns and residuals over their deviation.
        self._columns = np.zeros((_BLOCKS, n, 4))
        self._motors, self._shown, self._way = np.zeros((3, _BLOCKS, n))
        # Of these, joints that moved; and those that show the model's errors: nothing touched.
        self._moves, self._free = np.zeros((2, _BLOCKS, n), dtype=np.bool_)
        self._filled = self._since = 0  # the latter since one was found
        # Levels before: those of now are higher because one was found, and would hide its end.
        self._level_before = np.full(n, np.inf)
        self._prior = np.diag(np.array([*_ERRORS, *[_GAIN] * n]) ** -2.0)
        self._information, self._evidence = np.zeros((4 + n, 4 + n)), np.zeros(4 + n)

    def begin(self) -> None:
        """Begin anew with another model: its apparent errors may have been a load, too."""
        self._information[:], self._evidence[:] = 0.0, 0.0
        self.forget()

    def forget(self) -> None:
        """Forget the load, or the contact: it is another now. The model's errors are kept."""
        self.found, self.confirmed = None, False
        self._filled = self._again = self._unexplained = 0
        self.pause()

    def pause(self) -> None:
        """Leave out the present block, in which something is not known."""
        self._sum[:] = 0.0
        self._count, self._touched, self._before = 0, False, None

    def left(self, q: Vector, residual: Vector, threshold: Vector) -> Vector:
        """Thresholded residual (n,) [Nm] that the load found does not explain at q."""
        if self.found is None:
            return dead_band(residual, threshold)
        by_mass, by_place = self._model.payload_torques(q, self._model.down)
        torque = self.found.mass * (by_mass + by_place @ self.found.com)
        return dead_band(residual - torque, threshold)

    def step(
        self, q: Vector, q_dot: Vector, residual: Vector, threshold: Vector, *, touched: bool
    ) -> None:
        """Take the estimate of one tick, (n,) each; touched: a residual is beyond its threshold."""
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
            if self._unexplained >= self._patience:
                self.forget()
        if self._count >= self._ticks and self._sum[1].max() * self._period_s > _WAY / _BLOCKS:
            self._end_block(q, q_dot)

    def _end_block(self, q: Vector, q_dot: Vector) -> None:
        """Make the block that ends now one of the last ones, and look for a load in them."""
        touched, count = self._touched, self._count
        mean = self._sum / count
        velocity: np.ndarray = self._model.tool_jacobian(q) @ q_dot
        before = velocity if self._before is None else self._before
        way = count * self._period_s * mean[1]
        self.pause()
        if not np.isfinite(mean).all():
            return  # else it would stay in the tracked errors of the model
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
            (self._way, way),
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
        """True if the last blocks since then clearly show another mass in its place, or none."""
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
        """Count the blocks in a row that show a load, and then those that confirm it."""
        if self.found is None:
            self._again = self._again + 1 if fit else 0
            if fit and self._again >= _AGAIN:
                self.found, self._unexplained, self._again = fit.load, 0, 0
        else:
            self._again = self._again + 1 if fit and fit.confirms else 0
            if fit and self._again >= _CONFIRMS:
                self.found, self.confirmed = fit.load, True

    def _take_errors(self, free: NDArray[np.bool_]) -> None:
        """Add the oldest block to those before it, as far as it shows the model's errors."""
        if not free.any():
            return
        moved = np.hstack((self._columns[0], np.diag(self._motors[0])))[free]
        self._information += _ALIKE * (moved.T @ moved) - self._information / _FADES
        self._evidence += _ALIKE * (moved.T @ self._shown[0, free]) - self._evidence / _FADES

    def _less_errors(self) -> Matrix:
        """Residuals of the last blocks (blocks, n), less the model's errors."""
        errors = np.linalg.solve(self._prior + self._information, self._evidence)
        left: np.ndarray = self._shown - self._columns @ errors[:4] - self._motors * errors[4:]
        return left

    def _fit(self) -> _Fit | None:
        """Load that the last blocks show, None where they show none."""
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
        # Residual per kg there: by parts, the mass alone.
        per_kg = self._columns @ (fitted / mass)
        parts = _BLOCKS // _PART
        known = np.sum((per_kg**2).reshape(parts, -1), axis=1)
        off = np.sum((per_kg * shown).reshape(parts, -1), axis=1) / (known + 1e-12) - mass
        spread = float(np.sqrt(known @ off**2 / (known.sum() + 1e-12)))
        allowed = max(_SPREAD * mass, _SPREAD_KG)
        way = float(np.sum(self._way * (mass * np.abs(per_kg) > 1.0)))
        if (
            mass * np.sqrt(known.sum()) < _SURE
            or spread > allowed
            or np.max(np.abs(off) * np.sqrt(known / known.mean())) > _WORST * allowed
            or np.sum(per_kg * self._shown) < _SHOWS * mass * known.sum()
            or way < _WAY
        ):
            return None
        off_tool = fitted[1:] / mass
        if np.abs(off_tool).max() > _AT_HAND:
            return None
        load = Payload(mass=mass, com=(self._model.tool_place + off_tool).tolist())
        return _Fit(load, spread / mass, way)
