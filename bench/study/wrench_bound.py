"""Upper bound on the links that `bench.wrench` finds decided: the posterior over links given what
no arm knows, its own noise, the true shapes, and the distribution of hands (`hands.drawn`)."""

from typing import Final

import numpy as np

from bench.study.hands import THICK, Hands, any_way
from common.arrays import Matrix, Vector
from estimator.estimate import EstimateRows

SETTLED_S: Final = (0.35, 0.5)  # of a press, over which residuals are averaged
RIGHT: Final = 0.95
_SIZES_N: Final = np.array([1.5, 3.0, 6.0, 12.0, 25.0]).reshape(-1, 1)  # as log-uniform ones are
_LEAST: Final = 0.003  # of a contact level, of noise
_AT_TOOL, _BESIDE, _ON_LINKS = np.array([0.3, 0.3, 0.3]) / 0.9


def posteriors(
    hands: Hands, rows: EstimateRows, t: Vector, contact: Vector
) -> list[tuple[bool, float, bool, float]]:
    """For each single press: whether the most likely link is right, and its probability; with the
    prior of the draw, then with a uniform prior over links."""
    single = [press for press in hands.presses if press.place != "two"]
    begin, end = SETTLED_S
    ticks = [(t > press.onset_s + begin) & (t <= press.onset_s + end) for press in single]
    r = np.array([np.nan_to_num(rows.residual[k]).mean(axis=0) for k in ticks])
    q = np.array([rows.q[k].mean(axis=0) for k in ticks])
    touches = [press.touches[-1] for press in single]
    true = [hands.jacobian(q[k], one.row, one.point).T @ one.force for k, one in enumerate(touches)]
    error = r - np.array(true)
    most = 4.5 * np.median(np.abs(error), axis=0) + _LEAST * contact
    error = np.clip(error, -most, most)
    noise = error.T @ error / len(error) + np.diag(np.square(_LEAST * contact))
    found = []
    for k, one in enumerate(touches):
        J, row, odds = _hypotheses(hands, q[k])
        like = _likelihood(J, r[k], np.linalg.inv(noise)) * odds
        drawn = np.bincount(row, like)
        flat = drawn / np.bincount(row, odds)
        best, other = int(drawn.argmax()), int(flat.argmax())
        found.append(
            (best == one.row, float(drawn.max() / drawn.sum()),
             other == one.row, float(flat.max() / flat.sum()))
        )  # fmt: skip
    return found


def most_decided(right: Vector, sure: Vector) -> float:
    """Largest share of presses, the most certain first, of which RIGHT are right."""
    first = right[np.argsort(-sure)]
    enough = np.flatnonzero(np.cumsum(first) >= RIGHT * np.arange(1, len(first) + 1))
    return float((enough[-1] + 1) / len(first)) if len(enough) else 0.0


def _likelihood(J: Matrix, r: Vector, weight: Matrix) -> Vector:
    """Likelihood of each point, J (p, n, 3), up to a factor, for a force of any of the sizes in any
    direction."""
    JW = np.einsum("pia,ij->paj", J, weight)
    S = JW @ J + np.eye(3) / np.square(_SIZES_N)[..., np.newaxis, np.newaxis]
    h = JW @ r
    force = np.linalg.solve(S, h[..., np.newaxis])[..., 0]
    log = 0.5 * np.sum(h * force, axis=2) - 0.5 * np.linalg.slogdet(S)[1] - 3.0 * np.log(_SIZES_N)
    likelihood: Vector = np.exp(log - log.max()).sum(axis=0)
    return likelihood


def _hypotheses(hands: Hands, q: Vector) -> tuple[Matrix, Vector, Vector]:
    """Points as they are drawn: their J (p, n, 3), rows, and prior (p,)."""
    model, rng = hands.model, np.random.default_rng(0)
    tool = model.in_joint(model.tool_place)
    places = [(model.hand_joint, [tool], _AT_TOOL)]
    beside = [tool + 0.03 * rng.uniform() ** (1 / 3) * any_way(rng) for _ in range(60)]
    places.append((model.hand_joint, beside, _BESIDE))
    for row in range(model.n):
        end = hands.end(row)
        across = np.linalg.svd(end.reshape(1, 3))[2][1:]
        turns = [
            THICK * np.array([np.cos(a), np.sin(a)]) @ across for a in np.arange(12) * np.pi / 6
        ]
        surface = [part * end + aside for part in np.linspace(0.22, 0.98, 12) for aside in turns]
        places.append((row, surface, _ON_LINKS / model.n))
    J = [hands.jacobian(q, row, point).T for row, points, _ in places for point in points]
    rows = [row for row, points, _ in places for _ in points]
    odds = [share / len(points) for _, points, share in places for _ in points]
    return np.array(J), np.array(rows), np.array(odds)
