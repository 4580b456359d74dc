"""Recognition of a load: its mass and place, what is not a load, and when it is forgotten."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from estimator.model import Model
from estimator.payload import Payload
from estimator.recognition import Recognition
from tests.examples import scaled

T = 0.01
LEVEL = np.array([0.4, 0.25, 0.2, 0.15, 0.08, 0.08, 0.08])
OMEGA = 2 * np.pi / np.array([7.0, 5.3, 4.1, 6.1, 3.7, 4.7, 3.1])
HOME = np.array([0.3, 0.3, 0.0, -0.8, -1.2, 0.0, 0.0])
PLACE = np.array([0.08, 0.01, -0.02])
DOWN = np.array([0.0, 0.0, -9.81])

Torque = Callable[[Model, float, np.ndarray], np.ndarray]


def motion(t: float, amplitude: float, home: np.ndarray = HOME) -> tuple[np.ndarray, np.ndarray]:
    q = home + amplitude * np.sin(OMEGA * t)
    return q, amplitude * OMEGA * np.cos(OMEGA * t)


def run(
    recognition: Recognition, torque: Torque, begin_s: float, seconds: float,
    amplitude: float = 0.3, noise: float = 0.2, home: np.ndarray = HOME,
) -> float | None:  # fmt: skip
    """Time at which a load was found [s]; None if none was."""
    rng = np.random.default_rng(round(10 * begin_s))
    slow = np.zeros(7)
    for k in range(round(seconds / T)):
        t = begin_s + k * T
        q, q_dot = motion(t, amplitude, home)
        slow += 0.02 * (noise * LEVEL * rng.normal(size=7) * 10.0 - slow)
        residual = torque(recognition._model, t, q) + slow
        touched = bool((np.abs(residual) > LEVEL).any())
        recognition.step(q, q_dot, residual, LEVEL, touched=touched)
        if recognition.found is not None:
            return t
    return None


def load(mass: float, place: np.ndarray = PLACE) -> Torque:
    def torque(model: Model, t: float, q: np.ndarray) -> np.ndarray:
        by_mass, by_place = model.payload_torques(q, DOWN)
        return mass * (by_mass + by_place @ place)

    return torque


def pull(force: Callable[[float], np.ndarray]) -> Torque:
    """A hand that pulls at the tool with a force in the world [N]."""

    def torque(model: Model, t: float, q: np.ndarray) -> np.ndarray:
        pulled: np.ndarray = model.tool_jacobian(q).T @ force(t)
        return pulled

    return torque


@pytest.fixture
def recognition(romeo: Model) -> Recognition:
    return Recognition(romeo, T)


@pytest.mark.parametrize("mass", [0.15, 0.2, 0.5, 2.0])
def test_a_load_is_recognised_with_its_mass_and_place(
    recognition: Recognition, mass: float
) -> None:
    assert run(recognition, load(0.0), 0.0, 20.0) is None
    found_s = run(recognition, load(mass), 20.0, 10.0)
    assert found_s is not None
    assert recognition.found.mass == pytest.approx(mass, abs=max(0.02, 0.05 * mass))
    np.testing.assert_allclose(recognition.found.com, PLACE, atol=0.015)


def confirmed_s(
    recognition: Recognition, torque: Torque, begin_s: float, seconds: float
) -> float | None:
    """Time after which what is shown is confirmed [s]; None if it is not."""
    for k in range(round(seconds / T)):
        q, q_dot = motion(begin_s + k * T, 0.3)
        recognition.step(
            q, q_dot, torque(recognition._model, begin_s + k * T, q), LEVEL, touched=True
        )
        if recognition.confirmed:
            return k * T
    return None


def test_a_load_is_confirmed_by_two_more_seconds_of_motion_and_forgotten_as_a_whole(
    recognition: Recognition, romeo: Model
) -> None:
    assert run(recognition, load(0.5), 0.0, 10.0) is not None
    assert not recognition.confirmed
    assert confirmed_s(recognition, load(0.5), 10.0, 5.0) == pytest.approx(2.0, abs=0.3)
    q, q_dot = motion(12.0, 0.3)
    for _ in range(60):
        recognition.step(q, q_dot, load(2.0)(romeo, 12.0, q), LEVEL, touched=True)
    assert recognition.found is None
    assert not recognition.confirmed


def test_a_pull_that_varies_by_eight_per_cent_is_found_and_not_confirmed(
    recognition: Recognition,
) -> None:
    almost = pull(lambda t: 0.6 * DOWN * (1.0 + 0.08 * np.sin(2.0 * t)))
    found_s = run(recognition, almost, 0.0, 20.0)
    assert found_s is not None
    assert confirmed_s(recognition, almost, found_s, 25.0) is None
    assert recognition.found is not None


def test_the_mass_that_is_confirmed_is_that_of_the_last_seconds(recognition: Recognition) -> None:
    picked_up = pull(lambda t: 0.5 * DOWN * (1.0 + 0.2 * np.exp(-t / 2.0)))
    found_s = run(recognition, picked_up, 0.0, 20.0)
    assert found_s is not None
    first = recognition.found.mass
    assert first > 0.506
    assert confirmed_s(recognition, picked_up, found_s, 20.0) is not None
    assert abs(recognition.found.mass - 0.5) < 0.5 * (first - 0.5)


@pytest.mark.parametrize(("shoulder", "elbow"), [(0.7, 0.0), (-0.5, 0.4)])
def test_motors_off_by_a_share_do_not_change_the_mass_found_elsewhere(
    recognition: Recognition, shoulder: float, elbow: float
) -> None:
    gains = 0.06 * np.array([1.0, -1.0, 1.0, -1.0, 0.0, 0.0, 0.0])
    home = HOME + np.array([0.0, shoulder, 0.0, elbow, 0.0, 0.0, 0.0])

    def empty(model: Model, t: float, q: np.ndarray) -> np.ndarray:
        torque: np.ndarray = gains * model.gravity(q)
        return torque

    def loaded(model: Model, t: float, q: np.ndarray) -> np.ndarray:
        return empty(model, t, q) + load(0.3)(model, t, q)

    assert run(recognition, empty, 0.0, 60.0, amplitude=0.45) is None
    assert run(recognition, loaded, 60.0, 15.0, home=home) is not None
    assert recognition.found.mass == pytest.approx(0.3, abs=0.008)


HANDS: dict[str, Torque] = {
    "nothing": load(0.0),
    "below what is worth it": load(0.05),
    "upwards": load(-0.5),
    "sideways": pull(lambda t: np.array([6.0, 0.0, 0.0])),
    "slanting": pull(lambda t: np.array([3.0, 3.0, -5.0])),
    "down, a third more and less": pull(lambda t: DOWN * (0.6 + 0.2 * np.sin(1.3 * t))),
    "down, slower": pull(lambda t: DOWN * (0.6 + 0.25 * np.sin(0.5 * t))),
    "down, growing": pull(lambda t: DOWN * 0.06 * t),
    "down, now and then": pull(lambda t: DOWN * 0.5 * (t % 4.0 < 3.0)),
    "one joint": lambda model, t, q: np.array([0.0, 0.0, 0.0, 0.8, 0.0, 0.0, 0.0]),
    "two joints, for ever": lambda model, t, q: np.array([1.0, -0.6, 0.0, 0.0, 0.0, 0.0, 0.0]),
    "friction of a joint": lambda model, t, q: 0.6 * np.sign(np.cos(OMEGA * t)),
    "far from the hand": load(0.4, np.array([-0.25, 0.0, 0.0])),
}


@pytest.mark.parametrize("name", HANDS)
def test_other_torques_are_not_recognised_as_a_load(recognition: Recognition, name: str) -> None:
    assert run(recognition, HANDS[name], 0.0, 25.0) is None


@pytest.mark.parametrize("of", ["q", "residual", "threshold"])
def test_non_finite_input_is_not_kept(recognition: Recognition, of: str) -> None:
    run(recognition, load(0.0), 0.0, 10.0)
    q, q_dot = motion(10.0, 0.3)
    shown = {"q": q, "q_dot": q_dot, "residual": np.zeros(7), "threshold": LEVEL.copy()}
    shown[of] = np.full(7, np.nan)
    recognition.step(**shown, touched=False)
    run(recognition, load(0.0), 10.0, 10.0)
    assert run(recognition, load(0.5), 20.0, 10.0) is not None


def test_an_arm_that_stands_recognises_nothing(recognition: Recognition) -> None:
    assert run(recognition, load(0.5), 0.0, 30.0, amplitude=0.0) is None
    assert run(recognition, load(0.5), 0.0, 30.0, amplitude=1e-3) is None
    assert run(recognition, load(0.5), 0.0, 10.0) is not None


@pytest.mark.parametrize(
    "after",
    [load(0.0), load(1.0), load(-0.2), pull(lambda t: np.array([8.0, 0.0, -5.0]))],
    ids=["gone", "twice", "upwards", "another direction"],
)
def test_a_load_is_forgotten_when_it_no_longer_explains_the_residual(
    recognition: Recognition, romeo: Model, after: Torque
) -> None:
    assert run(recognition, load(0.5), 0.0, 10.0) is not None
    q, q_dot = motion(10.0, 0.3)
    same, other = load(0.5)(romeo, 10.0, q), after(romeo, 10.0, q)
    for _ in range(100):
        assert not recognition.left(q, same, LEVEL).any()
        recognition.step(q, q_dot, same, LEVEL, touched=True)
    assert recognition.found is not None
    assert recognition.left(q, other, LEVEL).any()  # at once
    for _ in range(49):
        recognition.step(q, q_dot, other, LEVEL, touched=True)
        assert recognition.found is not None
    recognition.step(q, q_dot, other, LEVEL, touched=True)
    assert recognition.found is None


@pytest.mark.parametrize("confirmed", [True, False])
@pytest.mark.parametrize("after", [0.0, 0.165], ids=["gone", "more"])
@pytest.mark.parametrize("raised", [1.0, 6.0])
def test_a_load_below_the_levels_is_forgotten_when_motion_shows_another(
    recognition: Recognition, romeo: Model, after: float, confirmed: bool, raised: float
) -> None:
    """No torque exceeds a level, so no tick shows that it is gone; and levels are raised because it
    was recognised."""
    level, found_s = np.array([0.8, 0.5, 0.4, 0.3, 0.2, 0.2, 0.2]), 0.0
    for k in range(round(40.0 / T)):
        q, q_dot = motion(k * T, 0.3)
        mass = after if found_s else 0.1 * (k * T > 15.0)
        torque = load(mass)(romeo, 0.0, q)
        assert not (np.abs(torque) > level).any()
        recognises = recognition.found is not None
        recognition.step(q, q_dot, torque, level * (raised if recognises else 1.0), touched=False)
        if not found_s and recognition.found is not None:
            if recognition.confirmed or not confirmed:
                found_s = k * T
        elif found_s and k * T > found_s + 11.0:
            break
    assert found_s
    assert recognition.found is None or recognition.found.mass == pytest.approx(after, rel=0.1)


def test_errors_of_the_model_are_subtracted_from_a_load(recognition: Recognition) -> None:
    """A hand that is 40 g heavier than the model's, and then takes 200 g."""
    assert run(recognition, load(0.04), 0.0, 120.0, noise=0.05) is None
    assert run(recognition, load(0.24), 120.0, 10.0, noise=0.05) is not None
    assert recognition.found.mass == pytest.approx(0.2, abs=0.02)


def test_a_load_is_not_learned_as_an_error_while_it_is_examined(
    recognition: Recognition, romeo: Model
) -> None:
    """It stays below the levels, so that its seconds count as errors of the model, too."""
    assert run(recognition, load(0.0), 0.0, 30.0, noise=0.05) is None
    before = recognition._evidence.copy()
    assert run(recognition, load(0.09), 30.0, 7.0, noise=0.05) is None
    again = Recognition(romeo, T)
    for begin_s, seconds in ((0.0, 30.0), (30.0, 7.0)):
        assert run(again, load(0.0), begin_s, seconds, noise=0.05) is None
    np.testing.assert_allclose(recognition._evidence, again._evidence)
    assert not np.allclose(recognition._evidence, before)  # of the motion before


@pytest.mark.parametrize("reported", [False, True])
def test_the_end_of_a_long_lift_is_not_recognised_as_a_load(
    recognition: Recognition, reported: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hand below the level, or a payload that was announced and is absent."""
    monkeypatch.setattr(f"{__name__}.LEVEL", 4.0 * LEVEL)
    assert run(recognition, load(-0.3), 0.0, 180.0, noise=0.02) is None
    if reported:
        recognition.begin()
        assert not recognition._evidence.any()
    assert run(recognition, load(0.0), 180.0, 30.0, noise=0.02) is None
    assert run(recognition, load(0.5), 210.0, 10.0, noise=0.02) is not None


def test_without_a_load_the_thresholded_residual_is_left(romeo: Model) -> None:
    r = np.array([0.5, -0.3, 0.1, 0.0, 0.1, 0.0, -0.2])
    expected = np.sign(r) * np.maximum(np.abs(r) - LEVEL, 0.0)
    np.testing.assert_allclose(Recognition(romeo, T).left(HOME, r, LEVEL), expected)


@settings(max_examples=scaled(15), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.integers(-6, 9).map(lambda power: 10.0**power),
    level=st.integers(-4, 3).map(lambda power: 10.0**power),
    mass=st.floats(-200.0, 200.0),
    amplitude=st.sampled_from([0.0, 0.01, 0.3, 1.5]),
)
def test_any_residual_yields_a_valid_payload_or_none(
    romeo: Model, seed: int, size: float, level: float, mass: float, amplitude: float
) -> None:
    """Residuals of any size beside any load, at levels of any size: a finding may be announced."""
    recognition, rng = Recognition(romeo, T), np.random.default_rng(seed)
    torque, threshold = load(mass), level * LEVEL
    for k in range(1000):
        q, q_dot = motion(k * T, amplitude)
        if k % 40 == 0:
            noise = size * rng.normal(size=7)
        residual = torque(romeo, k * T, q) + noise * (seed % 2)
        touched = bool((np.abs(residual) > threshold).any())
        recognition.step(q, q_dot, residual, threshold, touched=touched)
        if (found := recognition.found) is not None:
            assert Payload.of(found.mass, found.com) == found
            assert mass > 0.0 or seed % 2
    assert np.isfinite(recognition._evidence).all()
