"""Rules that hold in every tick: each can be broken, and what is right breaks none."""

import msgspec
import pytest

from bench.soak.invariants import false_alarms
from daemon.protocol.state import State
from tests.bench.soak.scenes import MIDDLE, C, broken_by, first, notices, state


def releasing(tick: int, velocity: float, way: float = 0.0) -> State:
    """A joint that is pressed upwards, and its commands."""
    felt, there = first(1.0), first(MIDDLE[0] + way, MIDDLE)
    changes = {"thresholded": felt, "link_position": there, "setpoint": first(velocity)}
    return state(tick, mode="releasing", **changes)


UPPER = C.joints[0].limits.upper
BROKEN: list[tuple[str, list[State]]] = [
    ("the arm comes back after a fault", [state(k, mode="off") for k in (1, 3000, 6002)]),
    ("setpoints within the velocity limit", [state(1, setpoint=first(1.01))]),
    (
        "no setpoint leads out of a limit",
        [state(1, link_position=first(UPPER, MIDDLE), setpoint=first(0.01))],
    ),
    ("no setpoint while latched", [state(1, mode="faulted", setpoint=first(0.001))]),
    ("no joint beyond its limit", [state(1, link_position=first(UPPER + 0.021, MIDDLE))]),
    (
        "joints led back to their limits",
        [state(k, link_position=first(UPPER + 0.006, MIDDLE)) for k in range(1, 110)],
    ),
    ("velocity steps bounded", [state(1), state(2, setpoint=first(0.1))]),
    # To brake that hard is right only before a limit.
    ("velocity steps bounded", [state(1, setpoint=first(0.5)), state(2)]),
    ("armed no longer than the lease", [state(51, armed=True), state(53, armed=True)]),
    ("not armed while latched", [state(1, armed=True, mode="off")]),
    ("time goes on", [state(1), state(2, time_s=0.01)]),
    ("a change of mode is reported", [state(1), state(2, mode="tracking")]),
    (
        "changes of mode are of the table",
        [state(1), state(2, mode="enabling", notices=notices("holding -> enabling: x"))],
    ),
    (
        "a change has a cause",
        [state(1), state(2, mode="tracking", notices=notices("holding -> tracking"))],
    ),
    ("a change of permission is reported", [state(1), state(2, armed=True)]),
    (
        "no unarmed arm is guided",
        [state(1), state(2, mode="admittance", notices=notices("holding -> admittance: x"))],
    ),
    ("a release goes the way of the push", [releasing(k, -0.02 * (k - 1)) for k in range(1, 4)]),
    ("a release is slow", [releasing(k, 0.04 * (k - 1)) for k in range(1, 11)]),
    (
        "a release is bounded in distance",
        [releasing(1, 0.0), releasing(2, 0.04, C.reactions.release_distance + 0.006)],
    ),
    ("a release is bounded in time", [releasing(k, 0.0) for k in (1, 300)]),
    (
        "no motion while latched",
        [state(k, mode="faulted", motor_velocity=first(0.1)) for k in range(1, 130)],
    ),
]


@pytest.mark.parametrize(("rule", "states"), BROKEN, ids=[rule for rule, _ in BROKEN])
def test_each_rule_can_be_broken(rule: str, states: list[State]) -> None:
    assert broken_by(states) == {rule}


def test_what_is_right_breaks_no_rule() -> None:
    arming = [*notices("armed: x"), *notices("holding -> tracking: y")]
    at_limit = first(UPPER, MIDDLE)
    states = (
        state(1),
        state(2, mode="tracking", armed=True, notices=arming),
        state(3, mode="tracking", armed=True, setpoint=first(0.04)),
        # The joint is at its limit: its speed is taken away at once.
        state(4, mode="tracking", armed=True, link_position=at_limit),
        # It lets go: what a blocked motor did not reach is given up at once.
        state(5, mode="tracking", armed=True, setpoint=first(-0.04)),
        state(6, mode="tracking", armed=True, setpoint=first(-0.08)),
        msgspec.structs.replace(
            releasing(7, 0.04), armed=True, notices=notices("tracking -> releasing: z")
        ),
        msgspec.structs.replace(releasing(8, 0.08), armed=True),
        state(
            9,
            mode="faulted",
            notices=[*notices("disarmed: z"), *notices("releasing -> faulted: z")],
        ),
    )
    assert not broken_by(states)


def test_a_contact_that_no_one_made_is_a_false_alarm() -> None:
    touches = [(10.0, 11.0), (20.0, 20.5)]
    assert false_alarms([10.0, 11.9, 20.4], touches) == 0
    assert false_alarms([9.9, 12.1, 15.0], touches) == 3
