"""Touched link and point of contact, on a plant whose surfaces and torques are not the model's."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import ROMEO
from bench.study.hands import Hands
from daemon.config.load import load_robot
from daemon.modes.table import Mode
from daemon.protocol.state import Snapshot, State
from programs.contactctl.point import point_now
from programs.recordings.touch_point import LinkDecision, TouchFinder, TouchPoint, touch_words
from tests.fake_daemon import snapshot_at, state_at

ROBOT = load_robot(ROMEO)
NAMES = list(ROBOT.model.names)
CONTACT = np.array([joint.thresholds.contact for joint in ROBOT.configuration.joints])
POSE = np.array([0.4, 0.3, -0.8, -1.0, -1.2, 0.2, 0.3])
ONE = np.ones(7)


def after(finder: TouchFinder, r: Any, ticks: int, level: Any = 0.5 * CONTACT) -> TouchPoint | None:
    found = None
    for _ in range(ticks):
        found = finder.take(POSE, np.asarray(r), level, 0.4 * ONE, 0.01)
    return found


def finder(urdf: str = ROBOT.urdf) -> TouchFinder:
    return TouchFinder(urdf, NAMES, CONTACT)


def pushed(row: int, point: Sequence[float], force: Sequence[float], seed: int = 1) -> Any:
    """Residuals of a force along the root's axes, a little off."""
    J = Hands(ROBOT.model, ROBOT.urdf).jacobian(POSE, row, np.array(point))
    rng = np.random.default_rng(seed)
    return J.T @ np.array(force) * rng.uniform(0.99, 1.01, 7) + 0.02 * CONTACT * rng.normal(size=7)


@pytest.mark.parametrize(
    ("row", "point", "force"),
    [(6, (0.06, 0.01, 0.0), (3.0, 14.0, -9.0)), (3, (0.1, 0.03, 0.0), (5.0, 12.0, 12.0))],
)
def test_the_link_and_the_point_on_it(row: int, point: Any, force: Any) -> None:
    found = after(one := finder(), pushed(row, point, force), 30)
    assert found is not None
    assert found.joints[0] == NAMES[row]
    assert found.decided
    assert found.placed
    rotation, origin = one.frames[found.link]
    at = rotation @ found.point + origin
    true = Hands(ROBOT.model, ROBOT.urdf).place(POSE, row, np.array(point))
    assert np.linalg.norm(at - true) < found.doubt_m < 0.09
    np.testing.assert_allclose(rotation @ found.force, force, atol=4.0)


def test_a_link_is_decided_once_its_residuals_have_settled() -> None:
    r = pushed(6, (0.06, 0.01, 0.0), (3.0, 14.0, -9.0))
    one = finder()
    after(one, 0.0 * r, 1)
    first, then = after(one, r, 1), after(one, r, 29)
    assert first is not None
    assert then is not None
    assert not first.decided
    assert then.decided
    assert after(one, 0.0 * r, 1) is None
    again = after(one, r, 1)
    assert again is not None
    assert not again.decided


@pytest.mark.parametrize(
    ("sure", "decided_after"),
    [
        (9 * [(6, 0.95)], 4),  # 0.06 s of it, after the first
        (9 * [(6, 0.45)], None),  # another is as likely
        (9 * [(6, 0.7), (6, 0.4)], 9),  # never long, but nearly always, for 0.2 s
        (9 * [(6, 0.55), (6, 0.4)], None),
        (9 * [(6, 0.7), (3, 0.7)], None),
        ([(3, 0.7), (6, 0.7), (6, 0.4)] * 6, None),
    ],
)
def test_a_link_is_decided_by_how_long_or_how_often_it_is_the_most_likely(
    sure: list[tuple[int, float]], decided_after: int | None
) -> None:
    likely = LinkDecision()
    said = [likely.decides(best, share, 0.03) for best, share in sure]
    assert (said.index(True) + 1 if True in said else None) == decided_after


def test_a_force_that_outer_joints_do_not_show_may_be_on_more_than_one_link() -> None:
    """Torque at one joint alone: it does not determine the point."""
    found = after(finder(), [0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0], 30)
    assert found is not None
    assert not found.placed
    assert NAMES[6] not in found.joints
    assert "where on it is not known" in touch_words(found)


def test_residuals_that_say_nothing_leave_the_last_link_as_likely_as_all_others() -> None:
    found = finder().take(POSE, CONTACT, 0.5 * CONTACT, 1e5 * ONE, 0.01)
    assert found is not None
    assert found.joints[0] == NAMES[6]
    assert found.sure == pytest.approx(0.5, abs=0.01)


def test_a_link_that_is_too_short_for_a_capsule_can_be_the_touched_one() -> None:
    short = NAMES.index("LElbowRoll")
    found = after(finder(), pushed(short, (0.0, 0.03, 0.0), (9.0, 9.0, 25.0)), 30)
    assert found is not None
    assert NAMES[short] in found.joints


def test_two_forces_are_not_fitted_as_one() -> None:
    both = pushed(1, (0.05, 0.0, 0.0), (0.0, 0.0, 30.0)) + pushed(
        6, (0.06, 0.0, 0.0), (9.0, 20.0, 9.0)
    )
    both[2] += 15.0
    found = after(finder(), both, 30)
    assert found is not None
    assert not found.placed


def test_collision_shapes_come_before_drafted_capsules() -> None:
    shape = (
        '<link name="l_wrist"><collision><origin xyz="0.3 0 0" rpy="0 1.5708 0"/><geometry>{}'
        "</geometry></collision>"
    )
    for geometry, far in (
        ('<cylinder radius="0.02" length="0.1"/>', 0.35),
        ('<box size="0.04 0.04 0.1"/>', 0.35),
        ('<sphere radius="0.03"/>', 0.33),
    ):
        assert '<link name="l_wrist">' in ROBOT.urdf
        urdf = ROBOT.urdf.replace('<link name="l_wrist">', shape.format(geometry))
        surface = finder(urdf).surfaces["l_wrist"]
        assert surface[:, 0].max() == pytest.approx(far, abs=0.01)
        assert surface[:, 0].min() > 0.24
    mesh = ROBOT.urdf.replace('<link name="l_wrist">', shape.format('<mesh filename="x.stl"/>'))
    np.testing.assert_array_equal(finder(mesh).surfaces["l_wrist"], finder().surfaces["l_wrist"])


def a_push() -> tuple[Snapshot, list[State]]:
    """One at the last link, of 0.4 s."""
    r = pushed(6, (0.06, 0.01, 0.0), (3.0, 14.0, -9.0)).tolist()
    states = [
        state_at(k, link_position=POSE.tolist(), residual=r if 30 <= k < 70 else [0.0] * 7)
        for k in range(20, 160)
    ]
    return msgspec.structs.replace(snapshot_at(19), urdf=ROBOT.urdf), states


def test_status_shows_the_present_point_and_subscribes_only_then() -> None:
    snapshot, states = a_push()
    client: Any = SimpleNamespace(subscribe=lambda: (snapshot, iter(states[15:])))
    status: Any = states[15]  # what it is asked for has the names of a State's
    assert point_now(client, status).startswith("l_wrist at (0.0")
    nothing: Any = None
    for quiet in (states[0], msgspec.structs.replace(status, mode=Mode.OFF)):
        assert point_now(nothing, quiet) == ""
