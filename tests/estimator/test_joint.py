"""The estimator's chain on one joint: (5) and (6), and the raise of its threshold.

All joints do the same: links move by `Q_DOT` and rotors by `THETA_DOT`, in gaps that are too wide
to be crossed meanwhile.
"""

from collections.abc import Callable

import numpy as np
import pytest

from estimator.estimate import Estimate
from estimator.estimator import Estimator
from estimator.interval import ROW
from estimator.model import Model
from estimator.motor_position import Side
from estimator.settings import EstimatorSettings, Variant
from estimator.thresholds import Thresholds

T = 0.01
WIDTH = 0.02
Q_DOT, THETA_DOT = 0.013, -0.021
PHI_DOT = Q_DOT - THETA_DOT
ONE = np.ones(7)
CONTACT = np.array([0.8, 0.5, 0.4, 0.3, 0.2, 0.2, 0.2])
PLAIN = {
    "half_gap": 0.05, "torque_constant": 2.0, "rotor_inertia": 0.0,
    "least_stiction": 0.0, "most_stiction": 0.0,
    "motor_coulomb": 1.0, "motor_viscous": 0.0, "link_coulomb": 0.0, "link_viscous": 0.0,
}  # fmt: skip


def sticking(least: float, most: float | None = None) -> dict[str, float]:
    """Parameters of stiction between these shares, by default of just that share."""
    return {"least_stiction": least, "most_stiction": least if most is None else most}


@pytest.fixture
def built(romeo: Model, make_transmission) -> Callable[..., Estimator]:
    def build(
        parameters: dict | None = None, per_speed: float = 0.0, **settings: object
    ) -> Estimator:
        transmission = make_transmission(**(PLAIN | (parameters or {})))
        levels = Thresholds(CONTACT, 6 * CONTACT, per_speed=np.array(per_speed))
        chosen = EstimatorSettings(**({"learning": False} | settings))
        return Estimator(romeo, transmission, chosen, levels, T)

    return build


def moving(estimator: Estimator, load: float, ticks: int = 110) -> Estimate:
    """Lean on the lower border, then go; `load` is what the motor gives beyond its friction."""
    rub = np.tanh(THETA_DOT / WIDTH)
    for _ in range(20):
        estimator.step(5.0 * ONE, 0.1 * ONE, 0.0 * ONE, 0.0 * ONE)
    for k in range(ticks):
        current = 0.5 * (rub + load) * ONE
        estimate = estimator.step(
            current, (0.1 + Q_DOT * T * k) * ONE, THETA_DOT * ONE, THETA_DOT * T * k * ONE
        )
    return estimate


def sign(velocity: float) -> float:
    return float(np.tanh(velocity / WIDTH))


# (6): friction while engaged and in the gap, for a parameter that is 0.1 more.
RUBS = {
    "motor_coulomb": (sign(THETA_DOT), 0.0, sign(THETA_DOT)),
    "motor_viscous": (THETA_DOT, 0.0, THETA_DOT),
    "link_coulomb": (sign(THETA_DOT), sign(Q_DOT), sign(Q_DOT)),
    "link_viscous": (THETA_DOT, Q_DOT, Q_DOT),
    "gap_coulomb": (0.0, sign(PHI_DOT), 0.0),
    "gap_viscous": (0.0, PHI_DOT, 0.0),
}


@pytest.mark.parametrize("parameter", RUBS)
@pytest.mark.parametrize(
    ("kind", "load", "state", "row"),
    [
        ("backlash", 5.0, Side.LEFT, 0),
        ("backlash", 0.0, Side.GAP, 1),
        ("classical", 0.0, Side.GAP, 0),
        ("two_mass", 5.0, Side.LEFT, 2),
        ("two_mass", 0.0, Side.GAP, 2),
    ],
)
def test_each_friction_acts_at_its_own_velocity(
    built, parameter: str, kind: str, load: float, state: Side, row: int
) -> None:
    more = PLAIN.get(parameter, 0.0) + 0.1
    settings = {"residual": Variant(kind=kind), "beside": (), "motor_position": "measured"}
    one = moving(built(**settings), load)
    other = moving(built({parameter: more}, **settings), load)
    np.testing.assert_array_equal(one.side, state)
    np.testing.assert_array_equal(other.side, state)
    # What rubs more is what the arm does not explain by itself, once the filter has settled.
    expected = 0.1 * RUBS[parameter][row]
    np.testing.assert_allclose(other.residual - one.residual, expected, atol=2e-6)


@pytest.mark.parametrize(
    ("load", "state", "rubs"),
    [(5.0, Side.LEFT, 5.0 * sign(THETA_DOT)), (-5.0, Side.RIGHT, 5.0 * sign(THETA_DOT)),
     (0.0, Side.GAP, 0.0)],
)  # fmt: skip
@pytest.mark.parametrize("learning", [False, True])
def test_friction_that_was_identified_grows_with_the_load(
    built, load: float, state: Side, rubs: float, learning: bool
) -> None:
    settings = {"beside": (), "motor_position": "measured", "learning": learning}
    identified = {"load_friction": 0.1, "load_friction_error": 0.02}
    one, other = (moving(built(p, **settings), load, 45) for p in (None, identified))
    np.testing.assert_array_equal(other.side, state)
    differ = other.uncorrected - one.uncorrected
    assert differ == pytest.approx(0.1 * rubs * ONE, abs=0.02 * abs(load) + 1e-5)


def test_each_signal_has_its_own_delay(built) -> None:
    # All of them grow by one per second; each arrives late by what is configured.
    estimator = built(
        current_delay_ms=3.0, link_position_delay_ms=1.0, motor_velocity_delay_ms=2.0,
        motor_position_delay_ms=0.5, motor_position="measured",
    )  # fmt: skip
    for k in range(5):
        t = T * k
        current, link = (t - 0.003) * ONE, (t - 0.001) * ONE
        estimate = estimator.step(current, link, (t - 0.002) * ONE, (t - 0.0005) * ONE)
    assert estimator.delay_s == pytest.approx(T / 2 + 0.001)
    instant = 4 * T - estimator.delay_s
    np.testing.assert_allclose(estimate.q, instant, atol=1e-12)
    np.testing.assert_allclose(estimate.tau_M / PLAIN["torque_constant"], instant, atol=1e-12)
    ends = estimator.memory()["interval"]["begin"]
    for name in ("theta_dot", "theta"):
        np.testing.assert_allclose(ends[ROW[name]], instant, atol=1e-12)


# The threshold in force


@pytest.mark.parametrize("stiction", [(0.4, 0.4), (0.0, 1.0)])
def test_a_joint_that_moves_has_its_contact_level(built, stiction: tuple[float, float]) -> None:
    # Whatever it holds near rest, and of that nothing is known, is no matter.
    estimator = built(sticking(*stiction), motor_position="measured")
    for k in range(200):
        q = 0.3 * T * k * ONE
        estimate = estimator.step(5.0 * ONE, q, 0.3 * ONE, q)
    np.testing.assert_array_equal(estimate.side, Side.LEFT)
    np.testing.assert_allclose(estimate.threshold, CONTACT, atol=1e-9)


@pytest.mark.parametrize("share", [0.25, 0.0, 1.0])
def test_thresholds_of_a_joint_whose_side_is_unknown_are_raised(built, share: float) -> None:
    loose = np.array([0.02, 0.02, 0.0, 0.02, 0.0, 0.0, 0.02])
    estimator = built({"half_gap": loose}, unknown_side_share=share, stiction_share=0.0)
    first = estimator.step(0.0 * ONE, 0.0 * ONE, 0.0 * ONE)
    # It begins with all of the friction, of which nothing is known yet either.
    coulomb = PLAIN["motor_coulomb"]
    np.testing.assert_allclose(first.threshold, CONTACT * (1.0 + share * (loose > 0.0)) + coulomb)
    # No torque that shows a side; then one that does, on the second joint.
    for _ in range(200):
        estimate = estimator.step(0.0 * ONE, 0.0 * ONE, 0.0 * ONE)
    np.testing.assert_array_equal(estimate.side == Side.UNKNOWN, loose > 0.0)
    raised = CONTACT * (1.0 + share * (loose > 0.0))
    np.testing.assert_allclose(estimate.threshold, raised, atol=1e-9)
    for _ in range(200):
        estimate = estimator.step(5.0 * (np.arange(7) == 1), 0.0 * ONE, 0.0 * ONE)
    assert estimate.side[1] == Side.LEFT
    raised[1] = CONTACT[1]
    np.testing.assert_allclose(estimate.threshold, raised, atol=1e-6)


def test_a_learned_level_is_raised_while_a_gap_is_crossed(built) -> None:
    # To what is needed there, until the tick in which the other border is met.
    alone = {"stiction_share": 0.0, "unknown_side_share": 0.0, "motor_position": "measured"}
    estimator, share = built(**alone), 0.4
    np.asarray(estimator.detector.levels.share)[:] = share
    estimate = moving(estimator, 5.0)
    np.testing.assert_array_equal(estimate.side, Side.LEFT)
    np.testing.assert_allclose(estimate.threshold, share * CONTACT, atol=1e-4)
    estimate = moving(built(**alone), 0.0)
    np.testing.assert_allclose(estimate.threshold, CONTACT, atol=1e-4)  # nothing was learned

    estimator = built(**alone)
    np.asarray(estimator.detector.levels.share)[:] = share
    np.asarray(estimator.detector.levels.crossing)[:] = 0.8
    estimate, whole, met = moving(estimator, 0.0), 0.8 - share, 0
    np.testing.assert_allclose(estimate.threshold, (share + whole) * CONTACT, atol=1e-4)
    raised, before = whole, Side.GAP
    for k in range(110, 125):
        at = THETA_DOT * T * k * ONE
        estimate = estimator.step(5.0 * ONE, (0.1 + Q_DOT * T * k) * ONE, THETA_DOT * ONE, at)
        side = Side(estimate.side[0])
        crosses, before = side == Side.GAP or side != before, side
        raised = whole if crosses else raised * np.exp(-0.5 * estimator.settings.gain * T)
        np.testing.assert_allclose(estimate.threshold, (share + raised) * CONTACT, atol=1e-4)
        met += side == Side.LEFT
    assert met > 5


def test_a_joint_without_a_gap_crosses_none(built) -> None:
    # The side of its torque is no border.
    estimator, share = built({"half_gap": 0.0}, stiction_share=0.0, unknown_side_share=0.0), 0.4
    np.asarray(estimator.detector.levels.share)[:] = share
    sides = set()
    for k in range(200):
        load = 5.0 if k % 20 < 10 else -5.0
        estimate = estimator.step(load * ONE, 0.3 * T * k * ONE, 0.3 * ONE)
        sides.add(int(estimate.side[0]))
        if k > 150:  # what the beginning raised has faded
            np.testing.assert_allclose(estimate.threshold, share * CONTACT, atol=1e-6)
    assert sides >= {Side.LEFT, Side.RIGHT}


@pytest.mark.parametrize("stiction", [(0.4, 0.4), (0.2, 0.5), (0.0, 1.0)])
def test_starting_anew_forgets_what_the_last_motion_left(
    built, stiction: tuple[float, float]
) -> None:
    estimator = built({**sticking(*stiction), "half_gap": 0.0}, motor_position="measured")
    least, most = stiction

    def threshold(travel: float) -> np.ndarray:
        for k in range(200):
            q = travel * min(k, 50) / 50 * ONE
            speed = travel / (50 * T) * (k < 50) * ONE
            estimate = estimator.step(0.0 * ONE, q, speed, q)
        return estimate.threshold - CONTACT - estimator.settings.stiction_share

    known = 0.5 * (most - least)
    np.testing.assert_allclose(threshold(0.0), most, atol=1e-6)
    np.testing.assert_allclose(threshold(0.1), known, atol=1e-6)
    np.testing.assert_allclose(threshold(0.0), known, atol=1e-6)
    estimator.restart()
    np.testing.assert_allclose(threshold(0.0), most, atol=1e-6)


def test_a_turn_raises_as_long_as_the_residual_shows_it(built) -> None:
    # At a turn it matters which pre-sliding is the true one; that passes the residual's filter.
    estimator = built({**sticking(0.8), "half_gap": 0.0}, stiction_share=0.0)
    gain, q, z = estimator.settings.gain, 0.0, np.ones(5)
    pole, share = (2 - gain * T) / (2 + gain * T), 2 * gain / (2 + gain * T)
    followed = np.geomspace(*estimator.settings.presliding, 5)
    filtered = unknown = most = at = 0.0
    for k in range(400):
        speed = 0.2 if k < 300 else -0.016
        q += speed * T
        estimate = estimator.step(0.0 * ONE, q * ONE, speed * ONE)
        before, at = at, float(estimate.q[0])
        if k >= 300:  # what was unknown in the beginning has faded
            z = np.clip(z + (at - before) / followed, -1.0, 1.0)
            then, unknown = unknown, 0.8 * 0.5 * float(z.max() - z.min())
            filtered = pole * filtered + share * 0.5 * T * (then + unknown)
        if k >= 250:
            np.testing.assert_allclose(estimate.threshold - CONTACT, filtered, atol=1e-6)
        most = max(most, filtered)
    assert most > 0.4
    assert filtered < 1e-3


@pytest.mark.parametrize("speed", [0.0, 0.03, -0.3])
@pytest.mark.parametrize("learning", [False, True])
def test_the_level_at_a_speed_is_that_which_a_steady_motion_has(
    built, speed: float, learning: bool
) -> None:
    parameters = {**sticking(0.2, 0.8), "motor_viscous": 0.5, "link_viscous": 0.25}
    # Half of what is unknown of friction, with nothing learned yet.
    unknown = 0.5 * (np.tanh(abs(speed) / WIDTH) + 0.75 * abs(speed)) * learning
    estimator = built(parameters, 0.2, motor_position="measured", learning=learning)
    rubs = np.tanh(speed / WIDTH) + 0.5 * speed
    for k in range(300):
        q = speed * T * (k - 300) * ONE
        current = 0.5 * (rubs - 9.0) * ONE
        estimate = estimator.step(current, q, speed * ONE, q)
    np.testing.assert_array_equal(estimate.side, Side.RIGHT)
    memory = estimator.memory()
    levels = estimator.levels_at(speed * ONE)
    rest = np.exp(-((speed / 0.05) ** 2))
    at_rest = rest**4 * estimator.settings.stiction_share  # that of twice the speed
    known = (speed != 0.0) and 0.5 * (0.8 - 0.2)
    expected = CONTACT + 0.2 * abs(speed) + at_rest + rest * (known or 0.8) + unknown
    np.testing.assert_allclose(levels, expected, atol=1e-9)
    assert estimator.memory() == memory
    if speed in (0.0, -0.3):  # between them, what stiction may hold depends on how it slows down
        np.testing.assert_allclose(estimate.threshold, levels, atol=1e-6)


@pytest.mark.parametrize(
    ("speed", "link_speed", "z"),
    [
        (0.007, 0.0, 1.0),  # the rotor alone, in its gap
        (0.002, 0.0, -1.0),  # a bias
        (0.002, 0.002, 1.0),  # both
        (0.002, -0.0001, -1.0),
        (0.002, 0.02, 1.0),  # the link alone, by a hand
    ],
)
def test_friction_of_a_creeping_rotor_turns_with_the_motion_of_its_link(
    built, speed: float, link_speed: float, z: float
) -> None:
    estimator = built(sticking(0.4))
    q = 0.0
    for k in range(300):
        after = min(max((k - 50) / 50, 0.0), 1.0)  # stopped at once, links seem to swing back
        moved, w = (after * end - 0.1 * (1.0 - after) for end in (link_speed, speed))
        q += moved * T
        estimator.step(0.0 * ONE, q * ONE, w * ONE)
    ends = estimator.memory()["stiction"]["ends"]
    np.testing.assert_allclose(np.mean(ends, axis=0), z, atol=0.1)


@pytest.mark.parametrize("time_s", [None, 77.0])
def test_a_contact_has_the_time_of_its_tick(built, time_s: float | None) -> None:
    # By default the sum of all intervals, those of samples that were not used included.
    estimator = built({"half_gap": 0.0})
    contacts = []
    for k in range(100):
        current = 5.0 * (k >= 60) * ONE
        if k == 30:
            current = np.nan * ONE
        dt = 1.2 * T if k == 20 else T
        estimate = estimator.step(current, 0.0 * ONE, 0.0 * ONE, dt=dt, time_s=time_s)
        contacts += [(k, c) for c in estimate.contacts if k >= 60]
    assert contacts
    for k, contact in contacts:
        expected = T * (k + 1.2) if time_s is None else time_s
        assert contact.time_s == pytest.approx(expected)
