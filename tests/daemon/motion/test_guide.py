"""Guide: what is held stands, what is free is as fast as before, nothing moves against a hand."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.rigs.lockstep import BEAM, DESK_ARM, OPENARM, ROMEO
from bench.study.hands import Hands
from common.arrays import Matrix, Vector
from daemon.config.load import load_robot
from daemon.config.vectors import limits_of
from daemon.motion.guidance import guide_place
from daemon.motion.guide import DAMPED, FREE, HELD, STIFF, Guide
from daemon.protocol.guide import AXES, GuideAxes
from estimator.model import Model
from tests.plain import plain

DT, RATE, MOST = 0.01, 8.0, 0.5
SHAPES: dict[str, tuple[int, ...]] = {
    "line": (FREE, STIFF, STIFF, FREE, FREE, FREE),
    "plane": (FREE, FREE, HELD, FREE, FREE, FREE),
    "line, not turned": (FREE, STIFF, STIFF, STIFF, STIFF, STIFF),
    "not turned": (FREE, FREE, FREE, STIFF, HELD, STIFF),
    "point": (STIFF, STIFF, STIFF, FREE, FREE, FREE),
}
HANDS: dict[Model, Hands] = {}


@pytest.fixture(scope="module", params=[ROMEO, OPENARM, BEAM], ids=lambda folder: folder.name)
def arm(request: pytest.FixtureRequest) -> tuple[Model, Vector, Vector, Vector]:
    """Model, gains, and the middle and half of each joint's range."""
    robot = load_robot(request.param)
    limits = limits_of(robot.configuration)
    gains = np.array([joint.admittance_gain for joint in robot.configuration.joints])
    HANDS[robot.model] = Hands(robot.model, robot.urdf)
    return robot.model, gains, (limits.lower + limits.upper) / 2, (limits.upper - limits.lower) / 2


class Led:
    """A guide, and joints that do what it commands."""

    def __init__(self, model: Model, gain: Vector, kinds: tuple[int, ...], **how: Any) -> None:
        self.model, self.gain = model, gain
        self.most = np.full(model.n, how.pop("most", MOST))
        of = how.pop("of", Guide)
        place = how.pop("place", model.place())
        self.guide = of(model, place, self.most, RATE, np.array(kinds), **how)

    def __call__(
        self, q: Vector, v: Vector, room: float = 9.0, moved: Vector | None = None,
        sent: Vector | None = None, *, springs: bool = True, residual: Vector | float = 0.0,
    ) -> Vector:  # fmt: skip
        out, moved = np.full(self.model.n, np.nan), 0.0 * v if moved is None else moved
        rooms = np.full((2, self.model.n), room)
        sent, none, whole = moved if sent is None else sent, 0.0 * v, 1.0 + 0.0 * v
        force = none + residual
        self.guide.step(q, moved, sent, none, v, whole, self.gain, rooms, force, springs, DT, out)
        return out

    def along(self, q: Vector) -> Matrix:
        """Jacobian of the tool and its turns along its axes at q."""
        rows = []
        for k in range(self.model.n):
            step = 1e-6 * np.eye(self.model.n)[k]
            (x, R), (y, S) = self.frame(q - step), self.frame(q + step)
            rows.append(np.concatenate((R.T @ (y - x), turn(R, S))) / 2e-6)
        return np.array(rows).T

    def frame(self, q: Vector) -> tuple[Vector, Vector]:
        """Point and axes of the tool along the root's."""
        return HANDS[self.model].at_tool(q)[0], self.model.axes(q)


def turn(before: Vector, after: Vector) -> Vector:
    """Small turn between two orientations, along the axes of the first."""
    between = before.T @ after
    return 0.5 * np.array(
        [between[2, 1] - between[1, 2], between[0, 2] - between[2, 0],
         between[1, 0] - between[0, 1]]
    )  # fmt: skip


@pytest.mark.parametrize("shape", SHAPES)
def test_holds_what_is_held_to_first_order_and_moves_with_the_hand(
    arm: tuple[Model, Vector, Vector, Vector], shape: str
) -> None:
    model, gain, middle, half = arm
    rng, kinds = np.random.default_rng(3), SHAPES[shape]
    held, moves = np.array(kinds) != FREE, 0
    for _ in range(60):
        q = middle + 0.6 * half * rng.uniform(-1.0, 1.0, model.n)
        push = rng.normal(size=model.n)
        v = gain * push * 0.02 / np.abs(gain * push).max()
        led = Led(model, gain, kinds)
        out = led(q, v)
        (x, R), (y, S) = led.frame(q), led.frame(q + 1e-4 * out)
        (x_free, R_free) = led.frame(q + 1e-4 * v)
        way = np.concatenate((R.T @ (y - x), 0.3 * turn(R, S))) / 1e-4
        free = np.concatenate((R.T @ (x_free - x), 0.3 * turn(R, R_free))) / 1e-4
        assert np.abs(way[held]).max() < 0.02 * np.abs(free).max() + 1e-5
        assert v / gain @ out >= 0.0
        assert out / gain @ out <= 9.0 * (v / gain @ v) + 1e-12
        assert np.abs(out).max() <= MOST
        moves += bool(np.abs(out).max() > 0.001)
    assert moves > 40


@pytest.mark.parametrize("shape", ["line", "line, not turned"])
def test_a_straight_line_stays_straight_while_it_is_led(
    arm: tuple[Model, Vector, Vector, Vector], shape: str
) -> None:
    """A hand pulls the tool to and fro along the line and across it; near what it cannot pass the
    arm stands instead of leaving the line, and comes back."""
    model, gain, middle, half = arm
    rng, gone = np.random.default_rng(4), 0
    for _ in range(6):
        q = middle + 0.5 * half * rng.uniform(-1.0, 1.0, model.n)
        led = Led(model, gain, SHAPES[shape])
        x, R = led.frame(q)
        v, far = np.zeros(model.n), 0.0
        for k in range(600):
            force = R @ np.array([25.0 if k % 400 < 200 else -25.0, 10.0, -10.0])
            asked = v + 0.2 * (gain * (model.tool_jacobian(q).T @ force) - v)
            v = led(q, asked, moved=v)
            q = q + DT * v
            y, S = led.frame(q)
            off = R.T @ (y - x)
            far = max(far, abs(off[0]))
            assert np.abs(off[1:]).max() < 3e-3
            if shape != "line":
                assert np.abs(turn(R, S)).max() < 0.02
        gone += far > 0.02
    assert gone > 2


def test_a_joint_at_its_limit_is_a_soft_wall(arm: tuple[Model, Vector, Vector, Vector]) -> None:
    """The others go on where they can, and the guide is kept."""
    model, gain, middle, half = arm
    rng = np.random.default_rng(5)
    q = middle + 0.4 * half * rng.uniform(-1.0, 1.0, model.n)
    v = 0.02 * gain * rng.normal(size=model.n)
    led = Led(model, gain, SHAPES["line"])
    free = led(q, v)
    i = int(np.abs(free).argmax())
    rooms, out = np.full((2, model.n), 9.0), np.empty(model.n)
    for room in (0.5, 0.2, 0.01, 0.0):
        rooms[:, i] = room * np.abs(free[i])
        none = 0.0 * v
        led.guide.step(q, none, none, none, v, none + 1.0, gain, rooms, none, False, DT, out)
        assert abs(out[i]) <= rooms[0, i] + 1e-5
        (x, R), (y, _) = led.frame(q), led.frame(q + 1e-4 * out)
        assert np.abs((R.T @ (y - x))[1:]).max() / 1e-4 < 1e-3
        assert v / gain @ out >= 0.0


def test_others_count_on_a_joint_that_lags_no_more_than_it_moves(
    arm: tuple[Model, Vector, Vector, Vector],
) -> None:
    model, gain, middle, half = arm
    q = middle + 0.3 * half
    v = gain * np.random.default_rng(6).normal(size=model.n)
    led, moved = Led(model, gain, SHAPES["line"]), 0.0 * v
    for _ in range(50):
        free = moved = led(q, v, moved=moved)
    i = int(np.abs(free).argmax())
    assert abs(free[i]) > 0.2
    moved = free.copy()
    moved[i] = 0.0
    out = led(q, v, moved=moved, sent=free)
    assert abs(out[i]) == pytest.approx(0.15, abs=1e-4)  # it presses on
    real = out.copy()
    real[i] = 0.0
    (x, R), (y, _) = led.frame(q), led.frame(q + 1e-4 * real)
    assert np.abs((R.T @ (y - x))[1:]).max() / 1e-4 < 1e-3


def test_the_spring_brings_back_slowly_what_a_hand_pushed_off(
    arm: tuple[Model, Vector, Vector, Vector],
) -> None:
    """Not without the hand, and not from further than its reach; the energy of its way is bounded
    by that. What is held without a spring stays."""
    model, gain, middle, half = arm
    q0 = middle + 0.3 * half
    J, still = model.tool_jacobian(q0), np.zeros(model.n)
    across = model.axes(q0)[:, 1]
    for kinds, springs in (
        (SHAPES["line"], True), (SHAPES["line"], False), ((FREE, HELD, HELD) + (FREE,) * 3, True)
    ):  # fmt: skip
        led = Led(model, gain, kinds)
        led(q0, still)
        q = q0 + np.linalg.pinv(J) @ (0.01 * across)
        off = across @ (led.frame(q)[0] - led.frame(q0)[0])
        v = led(q, still, springs=springs)
        speed = -across @ (model.tool_jacobian(q) @ v)
        assert np.abs(v).max() <= 0.3 + 1e-9
        if springs and kinds == SHAPES["line"]:
            assert 0.2 * RATE * off < speed <= 0.1 + 1e-9
            for _ in range(200):
                q = q + DT * led(q, still)
            assert abs(across @ (led.frame(q)[0] - led.frame(q0)[0])) < 2e-4
            far = q0 + np.linalg.pinv(J) @ (0.06 * across)
            led(far, still)
            assert abs(led.guide.spring.off[1]) == pytest.approx(0.03)
            led(q0 + np.linalg.pinv(J) @ (0.05 * across), still)
            assert 0.01 < abs(led.guide.spring.off[1]) < 0.028  # it begins where it slipped to
        else:
            np.testing.assert_array_equal(v, still)


@pytest.mark.parametrize("force", [0.0, 15.0, 24.0, 40.0])
def test_a_spring_that_a_force_withstands_fades_and_then_gives_way(
    arm: tuple[Model, Vector, Vector, Vector], force: float
) -> None:
    """An obstacle on its way back is felt as a hand, and must not be pressed on for ever."""
    model, gain, middle, half = arm
    q0, still = middle + 0.3 * half, np.zeros(model.n)
    led = Led(model, gain, SHAPES["line"])
    led(q0, still)
    across = model.axes(q0)[:, 1]
    q = q0 + np.linalg.pinv(model.tool_jacobian(q0)) @ (0.01 * across)
    whole = led(q, still)
    J = led.along(q)
    push = force * J[1]
    share = np.clip((28.0 - force) / 8.0, 0.0, 1.0)
    assert J[1] @ led(q, still, residual=push) == pytest.approx(
        share * (J[1] @ whole), rel=0.02, abs=1e-4
    )
    for _ in range(150):
        v = led(q, gain * push, residual=push)
    assert (led.guide.spring.off[1] == 0.0) == (force > 22.0)
    if force > 22.0:
        assert J[1] @ v > 1e-3  # away from the obstacle
        aside = q + np.linalg.pinv(J[:3]) @ (0.005 * np.eye(3)[2])
        led(aside, gain * push, residual=push)
        assert led.guide.spring.off[2] != 0.0
        for _ in range(150):
            led(aside, gain * push, residual=push)
        assert led.guide.spring.off[2] == 0.0  # nor does another direction press on
        led(q, still, springs=False)
        led(q, still)
        assert abs(J[1] @ led(q, gain * push)) < 1e-3  # held again, where it is


@pytest.mark.parametrize(("back", "share"), [(0.0, 1.0), (0.15, 0.5), (0.3, 0.0), (0.5, 0.0)])
def test_the_spring_asks_less_of_a_drive_that_a_hand_pushes_back(
    arm: tuple[Model, Vector, Vector, Vector], back: float, share: float
) -> None:
    """And the same of one that goes its way."""
    model, gain, middle, half = arm
    q0, still = middle + 0.3 * half, np.zeros(model.n)
    led = Led(model, gain, SHAPES["point"])
    led(q0, still)
    q = q0 + np.linalg.pinv(model.tool_jacobian(q0)) @ (0.01 * model.axes(q0)[:, 1])
    spring = led(q, still)
    moved = -back * np.sign(spring) * (np.abs(spring) == np.abs(spring).max())
    np.testing.assert_allclose(led(q, still, moved=moved, sent=still), share * spring, atol=1e-9)
    np.testing.assert_allclose(led(q, still, moved=-moved, sent=still), spring, atol=1e-9)


def test_leads_no_faster_than_without_where_it_is_free_and_slower_where_it_is_damped(
    arm: tuple[Model, Vector, Vector, Vector],
) -> None:
    model, gain, middle, half = arm
    rng, shares, damped = np.random.default_rng(8), [], []
    for _ in range(50):
        q = middle + 0.5 * half * rng.uniform(-1.0, 1.0, model.n)
        J, R = model.tool_jacobian(q), model.axes(q)
        v = 0.01 * gain * (J.T @ R[:, 0])
        before = R[:, 0] @ J @ v
        shares.append(R[:, 0] @ J @ Led(model, gain, SHAPES["line"])(q, v) / before)
        kinds = (DAMPED, FREE, FREE, FREE, FREE, FREE)
        damped.append(R[:, 0] @ J @ Led(model, gain, kinds)(q, v) / before)
    assert np.median(shares) > 0.3
    assert max(shares) < 1.0 + 1e-9
    assert 0.15 < np.median(damped) < 0.7


def test_redundant_joints_stand_where_they_are_held(
    arm: tuple[Model, Vector, Vector, Vector],
) -> None:
    model, gain, middle, half = arm
    q = middle + 0.3 * half * np.random.default_rng(9).uniform(-1.0, 1.0, model.n)
    led = Led(model, gain, (FREE,) * 6, redundant=False)
    x, R = led.frame(q)
    beside = np.linalg.svd(model.tool_jacobian(q))[2][-1]
    v = 0.1 * beside  # of the point at least
    out = led(q, v)
    assert out / gain @ out <= v / gain @ v + 1e-12
    assert v / gain @ out >= 0.0
    rest = v - out  # what was taken moves neither point nor axes
    y, S = led.frame(q + 1e-4 * rest)
    assert np.abs(y - x).max() / 1e-4 < 1e-3
    assert np.abs(turn(R, S)).max() / 1e-4 < 1e-3


def test_is_continuous_on_its_way_to_a_stretched_arm(
    arm: tuple[Model, Vector, Vector, Vector],
) -> None:
    """The velocity changes no faster than the pose by a bounded factor, where rows become
    dependent, too."""
    model, gain, middle, half = arm
    a, b = middle - 0.8 * half, np.zeros(model.n)
    v = 0.05 * gain * np.random.default_rng(10).normal(size=model.n)
    for kinds in SHAPES.values():
        jumps = []
        for steps in (150, 600):
            ways = np.linspace(0.85, 0.99, steps)
            outs = [
                Led(model, gain, kinds)(a + share * (b - a), v, springs=False) for share in ways
            ]
            jumps.append(float(np.abs(np.diff(outs, axis=0)).max()))
        assert jumps[1] < 0.6 * jumps[0] + 5e-3


def test_stands_where_a_position_is_not_known_and_does_not_begin_there(
    arm: tuple[Model, Vector, Vector, Vector],
) -> None:
    model, gain, middle, _ = arm
    q, v = middle.copy(), np.full(model.n, 0.1)
    q[0] = np.nan
    led = Led(model, gain, SHAPES["line"])
    led.guide.begin(q)
    assert not led.guide.started
    np.testing.assert_array_equal(led(q, v), 0.0 * v)
    assert np.isfinite(led(middle, v)).all()


def steady(
    led: Led, q: Vector, v: Vector, push: Vector, seconds: float = 2.0, *, springs: bool = False
) -> Vector:
    """Velocity that a push (n,) [Nm] leads to, from v on, with a virtual mass, at one pose."""
    share, rooms, none = np.full(len(v), 1.0 / 6.0), np.full((2, len(v)), 9.0), 0.0 * v
    for _ in range(round(seconds / DT)):
        before, v = v, np.empty_like(v)
        asked = led.gain * push
        led.guide.step(q, none, none, before, asked, share, led.gain, rooms, none, springs, DT, v)
    return v


@pytest.mark.parametrize("shape", SHAPES)
def test_what_a_hand_no_longer_pushes_comes_to_rest_whatever_it_pushes_against(
    arm: tuple[Model, Vector, Vector, Vector], shape: str
) -> None:
    """A push that the guide holds off keeps up no motion that is there from before."""
    model, gain, middle, half = arm
    rng, kinds = np.random.default_rng(13), SHAPES[shape]
    for _ in range(20):
        q = middle + 0.6 * half * rng.uniform(-1.0, 1.0, model.n)
        along = rng.normal(size=model.n)
        led = Led(model, gain, kinds)
        v = steady(led, q, np.zeros(model.n), 0.1 * along / np.abs(gain * along).max())
        rows = led.along(q)[np.array(kinds) != FREE]
        across = rows.T @ rng.normal(size=len(rows))
        across *= 0.2 / np.abs(gain * across).max()
        assert np.abs(steady(led, q, v, across)).max() < 1e-3


@pytest.mark.parametrize("shape", SHAPES)
def test_a_strong_hand_moves_nothing_against_itself(
    arm: tuple[Model, Vector, Vector, Vector], shape: str
) -> None:
    """However far its torques are beyond those of the largest velocity."""
    model, gain, middle, half = arm
    rng = np.random.default_rng(14)
    for _ in range(100):
        q = middle + 0.6 * half * rng.uniform(-1.0, 1.0, model.n)
        push = 5.0 * rng.normal(size=model.n)
        out = steady(Led(model, gain, SHAPES[shape]), q, np.zeros(model.n), push, 0.5)
        assert push @ out > -1e-9
        assert np.abs(out).max() <= MOST + 1e-12
        first = steady(Led(model, gain, SHAPES[shape]), q, np.zeros(model.n), push, DT)
        fastest = np.full(model.n, MOST / 6.0)  # by the virtual mass
        assert first / gain @ first <= fastest / gain @ fastest + 1e-9


def test_joints_at_their_ends_and_dampers_turn_nothing_against_the_hand(
    arm: tuple[Model, Vector, Vector, Vector],
) -> None:
    """Nor is it led more easily than without a guide, whatever is held."""
    model, gain, middle, half = arm
    rng, none = np.random.default_rng(7), np.zeros(model.n)
    for _ in range(500):
        kinds, q = rng.integers(0, 4, 6), middle + half * rng.uniform(-1.0, 1.0, model.n)
        push = 10.0 ** rng.uniform(-2.0, 1.0) * rng.normal(size=model.n)
        rooms = rng.uniform(0.0, 2.0, (2, model.n)) * (rng.random((2, model.n)) > 0.2)
        led, out = Led(model, gain, tuple(kinds), redundant=bool(rng.integers(2))), none + np.nan
        moved = 0.3 * rng.normal(size=model.n)
        led.guide.step(
            q, moved, none, none, gain * push, none + 0.2, gain, rooms, none, False, DT, out
        )
        assert push @ out >= -1e-9 * np.abs(push).max() * np.abs(out).max()
        assert out / gain @ out <= 0.2 * (push @ out) + 1e-12


def test_a_damped_way_is_led_at_a_fifth_of_the_speed(
    arm: tuple[Model, Vector, Vector, Vector],
) -> None:
    model, gain, middle, half = arm
    q = middle + 0.3 * half
    ahead = model.axes(q)[:, 0] @ model.tool_jacobian(q)
    push, none = 0.01 * ahead, np.zeros(model.n)
    led = Led(model, gain, (DAMPED, FREE, FREE, FREE, FREE, FREE))
    assert ahead @ steady(led, q, none, push) == pytest.approx(
        0.2 * (ahead @ (gain * push)), rel=0.01
    )


@pytest.mark.parametrize("shape", SHAPES)
def test_the_spring_moves_the_tool_no_faster_than_it_may(
    arm: tuple[Model, Vector, Vector, Vector], shape: str
) -> None:
    """Nor does any joint, in all directions together."""
    model, gain, middle, half = arm
    rng, still = np.random.default_rng(15), np.zeros(model.n)
    for most in (MOST, 0.05):
        for _ in range(100):
            led = Led(model, gain, SHAPES[shape], most=most)
            q = middle + 0.9 * half * rng.uniform(-1.0, 1.0, model.n)
            led.guide.begin(q)
            q = q + 0.1 * rng.normal(size=model.n)
            out = led(q, still)
            assert np.linalg.norm(model.tool_jacobian(q) @ out) <= 0.1 + 1e-9
            assert np.abs(out).max() <= min(most, 0.3) + 1e-9


def test_axes_of_the_root_and_of_a_link(arm: tuple[Model, Vector, Vector, Vector]) -> None:
    model, gain, middle, half = arm
    q = middle + 0.3 * half
    v = gain * np.random.default_rng(11).normal(size=model.n)
    base = Led(model, gain, SHAPES["plane"], turned=False)
    out = base(q, v)
    assert abs((model.tool_jacobian(q) @ out)[2]) < 1e-3
    axes = GuideAxes(frame="no_such", stiff=("x",))
    with pytest.raises(Exception, match=r"moves no link 'no_such'.* or it is tool or base"):
        guide_place(model, axes)


def test_compiled_and_plain_agree_bit_for_bit(arm: tuple[Model, Vector, Vector, Vector]) -> None:
    model, gain, middle, half = arm
    rng, source = np.random.default_rng(12), plain("daemon.motion")["guide"].Guide
    for kinds in SHAPES.values():
        both = (
            Led(model, gain, kinds, redundant=False),
            Led(model, gain, kinds, redundant=False, of=source),
        )
        q = middle + 0.5 * half * rng.uniform(-1.0, 1.0, model.n)
        for _ in range(20):
            v = 0.1 * gain * rng.normal(size=model.n)
            a, b = (led(q, v, room=0.2, moved=0.5 * v) for led in both)
            np.testing.assert_array_equal(a, b)
            q = q + 0.02 * rng.normal(size=model.n)


@pytest.mark.parametrize(
    ("axes", "joints", "said"),
    [
        (GuideAxes(stiff=("x", "y")), 7, ""),
        (GuideAxes(stiff=("x",), free=("x",)), 7, "x named twice: an axis is free or"),
        (GuideAxes(stiff=("x", "x")), 7, "x named twice"),
        (GuideAxes(free=("x",)), 7, "free alone holds nothing"),
        (GuideAxes(stiff=AXES), 6, "6 directions held leave an arm of 6 joints none"),
        (GuideAxes(stiff=AXES), 7, ""),
        (GuideAxes(held=("x",)), 1, "1 directions held leave an arm of 1 joints none"),
        (GuideAxes(), 1, ""),
    ],
)
def test_what_is_no_guide(axes: GuideAxes, joints: int, said: str) -> None:
    reasons = axes.objections(joints)
    assert bool(reasons) == bool(said)
    assert said in "; ".join(reasons)


def test_rows_about_to_become_dependent_are_a_soft_wall_that_may_be_left() -> None:
    """Next to a stretched arm, one of two opposite hands moves it: that which bends it."""
    robot = load_robot(OPENARM)
    model, limits = robot.model, limits_of(robot.configuration)
    gain = np.array([joint.admittance_gain for joint in robot.configuration.joints])
    middle, half = (limits.lower + limits.upper) / 2, (limits.upper - limits.lower) / 2
    q = 0.02 * (middle - 0.8 * half)
    v = 0.5 * gain * np.random.default_rng(10).normal(size=model.n)
    ways = [Led(model, gain, SHAPES["line, not turned"])(q, s * v, springs=False) for s in (1, -1)]
    slow, fast = sorted(float(np.abs(way).max()) for way in ways)
    assert slow < 0.05 * fast
    assert fast > 1e-3


@pytest.mark.parametrize(
    ("folder", "kinds", "near"),
    [(DESK_ARM, (FREE, FREE, STIFF) + (FREE,) * 3, 0.5), (BEAM, (FREE,) + (STIFF,) * 5, 1e-4)],
)
def test_where_a_held_row_is_nearly_zero_it_does_not_chatter(
    folder: Path, kinds: tuple[int, ...], near: float
) -> None:
    """Neither of an arm that cannot leave the plane where it begins, nor of a straight one."""
    robot = load_robot(folder)
    model, limits = robot.model, limits_of(robot.configuration)
    gain = np.array([joint.admittance_gain for joint in robot.configuration.joints])
    for seed in range(6):
        rng = np.random.default_rng(seed)
        away = near * rng.uniform(-1.0, 1.0, model.n) * (limits.upper - limits.lower) / 2
        q = away + (limits.lower + limits.upper) / 2 * (near > 0.1)
        led, v, push, speeds = Led(model, gain, kinds), 0.0 * q, rng.normal(size=model.n), []
        push *= 0.2 / np.abs(gain * push).max()
        for _ in range(300):
            v = steady(led, q, v, push, DT, springs=True)
            q = q + DT * v
            speeds.append(v)
        assert np.abs(np.diff(speeds, axis=0))[20:].max() < 0.02
        assert np.abs(speeds).max() > 1e-4
