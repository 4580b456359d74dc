"""Trends, broken rules and false alarms of the soak; and some seconds of it."""

import logging
import math
from contextlib import closing
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import numpy as np
import pytest

from bench.rigs.faults import CASES
from bench.rigs.lockstep import ROMEO, lockstep_rig
from bench.soak import outside_faults
from bench.soak.invariants import Watch, false_alarms
from bench.soak.onlooker import Onlooker
from bench.soak.people import (
    HEARD_TICKS,
    LAPSES_TICKS,
    WISHES,
    Leases,
    Person,
    Step,
    View,
    operator,
    program,
)
from bench.soak.record import Ledger, Part
from bench.soak.report import failures
from bench.soak.robot import gives_way, hand_script, strongest, write_robot
from bench.soak.simulated import FAULTS, UNFIT, run_lockstep
from bench.soak.trend import Bound, trend
from daemon.config.load import load_robot
from daemon.config.schema import Configuration
from daemon.modes.table import Mode
from daemon.protocol.messages import Notice, Reply, Request, State, Timing
from daemon.tick.tick import STOP_PROVED
from drivers.cia402 import PowerTarget
from drivers.stop_stages import Seen, StopWatch, worst_travel
from simulator.hand import Hand, Push

C = load_robot(ROMEO).configuration
MIDDLE = [(joint.limits.lower + joint.limits.upper) / 2 for joint in C.joints]
TIMES = [float(t) for t in range(120)]


def noise(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, 20.0, len(TIMES))


@pytest.mark.parametrize(
    ("values", "grows"),
    [
        (1000.0 + noise(), False),
        (1000.0 + noise() + 2.0 * np.array(TIMES), True),  # by 118 in the second half
        (1000.0 - 2.0 * np.array(TIMES), False),
        # A start that takes memory, once.
        (1000.0 + 500.0 * (np.array(TIMES) > 30.0), False),
        # A few bad moments of a busy machine.
        (1000.0 + 1e5 * (np.arange(120) % 10 == 9), False),
        (1000.0 + np.maximum(0.0, np.array(TIMES) - 60.0) * 3.0, True),
    ],
)
def test_a_trend_is_a_growth_that_lasts(values: np.ndarray, grows: bool) -> None:
    found = trend("x", Bound("kB", share=0.05, least=10.0), TIMES, list(values))
    assert found.grows is grows, found


def test_too_few_samples_are_no_trend() -> None:
    with pytest.raises(ValueError, match="too few"):
        trend("x", Bound("", 0.0, 1.0), [1.0, 2.0, 3.0], [1.0, 1.0, 1.0])


# --- rules ----------------------------------------------------------------------------------------


def state(tick: int, **changes: Any) -> State:
    n = len(C.joints)
    zeros = [0.0] * n
    plain: dict[str, Any] = {
        "tick": tick,
        "time_s": 0.01 * tick,
        "interval_s": 0.01,
        "mode": "holding",
        "armed": False,
        "cause": "",
        "moving": False,
        "fresh": [True] * n,
        "drives": [""] * n,
        "current": zeros,
        "link_position": MIDDLE,
        "motor_velocity": zeros,
        "motor_position": None,
        "link_velocity": zeros,
        "motor_estimate": zeros,
        "phi": zeros,
        "phi_sigma": zeros,
        "side": [""] * n,
        "motor_torque": zeros,
        "residual": zeros,
        "threshold": zeros,
        "thresholded": zeros,
        "touched_link": "",
        "beside": {},
        "flags": [],
        "reference": zeros,
        "setpoint": zeros,
        "quiet_s": 0.0,
        "notices": [],
        "timing": Timing(wall_s=0.0, monotonic_s=0.0, lateness_us=0.0, work_us=0.0, missed=0),
    }
    return State(**{**plain, **changes})


def first(value: float, others: list[float] | None = None) -> list[float]:
    rest = others or [0.0] * len(C.joints)
    return [value, *rest[1:]]


def notices(text: str) -> list[Notice]:
    return [Notice(kind="mode", text=text)]


def releasing(tick: int, velocity: float, way: float = 0.0) -> State:
    """A joint that is pressed upwards, and what it is told."""
    felt, there = first(1.0), first(MIDDLE[0] + way, MIDDLE)
    changes = {"thresholded": felt, "link_position": there, "setpoint": first(velocity)}
    return state(tick, mode="releasing", **changes)


UPPER = C.joints[0].limits.upper
GIVES_WAY = 0.02
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
        "nobody guides an arm that is not armed",
        [state(1), state(2, mode="admittance", notices=notices("holding -> admittance: x"))],
    ),
    (
        "a release goes the way of the push",
        [releasing(k, -0.02 * (k - 1)) for k in range(1, 4)],
    ),
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


PROVED = Notice(kind="mode", text=STOP_PROVED)
TRAVEL = worst_travel(C.joint_drives, C.period_s, C.supervisor.stale_ticks)[0].total


def faulted(tick: int, **changes: Any) -> State:
    return state(tick, **{"mode": "faulted", "cause": "why", **changes})


def fault(tick: int, **changes: Any) -> State:
    return faulted(tick, notices=notices("holding -> faulted: why"), **changes)


def reset(tick: int) -> State:
    return state(tick, mode="off", notices=notices("faulted -> off: reset"))


def again(tick: int, **changes: Any) -> State:
    return faulted(tick, notices=notices("off -> faulted: why"), **changes)


DOUBTED = [state(1), *(fault(2) if k == 2 else faulted(k, unproved=["x"]) for k in range(2, 104))]
MOVES = [state(1), fault(2), faulted(3, notices=[PROVED]), faulted(4)]
MOVES += [faulted(k, motor_velocity=first(0.06)) for k in (32, 34)]
GOES_ON = [state(1), fault(2), faulted(3, link_position=first(MIDDLE[0] + TRAVEL + 0.01, MIDDLE))]
BROKEN += [
    ("no motion after a proved stop", MOVES),
    ("no joint goes further than is printed", GOES_ON),
    ("a stop is proved or the arm silent", DOUBTED),
    ("one reset is enough", [faulted(1), reset(2), again(52)]),
]
Scene = tuple[State, bool, bool]  # with a hand, with a fault being made
KEPT: dict[str, list[Scene]] = {
    "it brakes for a moment": [(each, False, False) for each in MOVES[:-1]],
    "a hand moves it": [(each, each.tick == 4, False) for each in MOVES],
    "a hand drags it": [(each, each.tick == 2, False) for each in GOES_ON],
    "as far as is printed": [
        (each, False, False)
        for each in (*GOES_ON[:2], faulted(3, link_position=first(MIDDLE[0] + TRAVEL, MIDDLE)))
    ],
    "not fresh": [
        (each, False, False)
        for each in (
            *GOES_ON[:2],
            faulted(3, link_position=[9.0] * 7, motor_velocity=[9.0] * 7, fresh=[False] * 7),
        )
    ],
    "in time": [(each, False, False) for each in DOUBTED[:-1]],
    "silent": [(msgspec.structs.replace(s, silenced=s.tick > 50), False, False) for s in DOUBTED],
    "suspended": [(state(1), False, False), (fault(2), False, False)]
    + [(faulted(k, unproved=["x"]), False, False) for k in (3, 303, 304)],
    "it holds": [(each, False, False) for each in (faulted(1), reset(2), state(63, mode="off"))],
    "a new cause": [(faulted(1), False, False), (reset(2), False, False), (again(52), False, True)],
}


@pytest.mark.parametrize("name", KEPT)
def test_what_a_stop_may_do_breaks_no_rule(name: str) -> None:
    ledger = Ledger()
    watch = Watch(C, ledger, GIVES_WAY)
    for each, touched, trouble in KEPT[name]:
        watch.see(each, lease_until_s=0.5, lease_ticks=1, touched=touched, trouble=trouble)
    assert not ledger.broken, ledger.cases


@pytest.mark.parametrize(("rule", "states"), BROKEN, ids=[rule for rule, _ in BROKEN])
def test_each_rule_can_be_broken(rule: str, states: list[State]) -> None:
    ledger = Ledger()
    watch = Watch(C, ledger, GIVES_WAY)
    for each in states:
        watch.see(each, lease_until_s=0.5, lease_ticks=1, touched=False, trouble=False)
    assert set(ledger.broken) == {rule}, ledger.cases
    part = Part("x", 1, ledger=ledger)
    assert failures([part])[0].startswith(f"x: {rule}, ")


def test_what_is_right_breaks_no_rule() -> None:
    ledger = Ledger()
    watch = Watch(C, ledger, GIVES_WAY)
    arming = [*notices("armed: x"), *notices("holding -> tracking: y")]
    at_limit = first(UPPER, MIDDLE)
    for each in (
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
    ):
        watch.see(each, lease_until_s=0.5, lease_ticks=1, touched=False, trouble=False)
    assert not ledger.broken, ledger.cases


def test_a_contact_that_nobody_made_is_a_false_alarm() -> None:
    touches = [(10.0, 11.0), (20.0, 20.5)]
    assert false_alarms([10.0, 11.9, 20.4], touches) == 0
    assert false_alarms([9.9, 12.1, 15.0], touches) == 3


def test_the_onlooker_knows_when_a_hand_is_on_the_arm(tmp_path: Path) -> None:
    events = tmp_path / "events"

    def happen(*rows: tuple[float, str, str]) -> None:
        with events.open("ab") as stream:
            for time_s, kind, text in rows:
                event = {"monotonic_s": time_s, "kind": kind, "text": text}
                stream.write(msgspec.json.encode(event) + b"\n")

    happen((1.0, "server", "listening on x"))
    with closing(Onlooker(events)) as onlooker:
        assert not onlooker.look()
        happen((2.0, "hand", "begin push joint 2 Nm"))
        assert onlooker.look()
        happen((2.5, "hand", "end push joint 2 Nm"), (3.0, "hand", "begin guide joint to 1 rad"))
        with events.open("ab") as stream:
            stream.write(b'{"monotonic_s": 4.0, "kind": "ha')  # not whole yet
        assert onlooker.look()
        assert onlooker.touches == [(2.0, 2.5), (3.0, float("inf"))]
        with events.open("ab") as stream:
            stream.write(b'nd", "text": "begin release"}\n')
        assert not onlooker.look()
        assert onlooker.touches == [(2.0, 2.5), (3.0, 4.0)]


# --- the hand, and people -------------------------------------------------------------------------


def test_the_hand_is_one_that_the_simulator_can_play() -> None:
    acts = hand_script(Random(1), C, 600.0)
    Hand(acts, C.joint_names, np.full(len(C.joints), 1.0))
    assert msgspec.yaml.decode(msgspec.yaml.encode(acts), type=type(acts)) is not None
    assert [act.at_s for act in acts] == sorted(act.at_s for act in acts)
    assert {type(act).__name__ for act in acts} == {"Push", "Guide", "Hold", "Release"}


def wishes(person: Person, view: View, turns: int) -> list[Step]:
    next(person)
    return [person.send(view) for _ in range(turns)]


def test_people_want_much_and_not_all_of_it_is_right() -> None:
    steps = wishes(operator(Random(1), C), View(Mode.HOLDING, False, False), 2000)
    asked = {request.command for step in steps for request in step.requests}
    assert asked >= {"start", "arm", "load", "gain", "disable", "stop", "reset", "pause", "status"}
    steps = wishes(program(Random(1), C), View(Mode.HOLDING, True, False), 400)
    assert any(step.hang_up and not step.requests for step in steps)  # it dies
    assert any(step.requests and step.requests[0].command == "disarm" for step in steps)


def test_leases_are_known_from_the_answers() -> None:
    leases, granted, refused = Leases(), Reply(ok=True), Reply(ok=False)
    short, detached = Request("arm", lease_s=2.0), Request("arm", detached=True)
    one, two = leases.connection(), leases.connection()
    leases.asked(short, one)
    assert leases.until_s == math.inf  # it may be granted before it is known
    leases.answered(short, granted, one, 10.0)
    assert (leases.until_s, leases.ticks) == (12.0, LAPSES_TICKS)
    leases.closed(two, 10.5)
    assert leases.until_s == 12.0
    leases.closed(one, 11.0)
    assert (leases.until_s, leases.ticks) == (11.0, HEARD_TICKS)
    leases.asked(detached, two)
    leases.answered(detached, refused, two, 11.0)
    assert leases.until_s == 11.0
    leases.answered(detached, granted, two, 11.0)
    leases.closed(two, 12.0)
    assert (leases.until_s, leases.ticks) == (611.0, LAPSES_TICKS)


def test_what_was_asked_and_not_answered_may_have_been_granted() -> None:
    leases = Leases()
    one, two = leases.connection(), leases.connection()
    leases.asked(Request("arm", lease_s=2.0), one)
    leases.closed(one, 10.0)
    assert (leases.until_s, leases.ticks) == (10.0, HEARD_TICKS)  # whoever held it is gone
    leases.asked(Request("arm", lease_s=2.0, detached=True), two)
    leases.closed(two, 11.0)
    assert leases.until_s == 13.0  # a person's lease outlives their connection
    leases.asked(Request("arm", lease_s=2.0), one)
    leases.closed(one, 12.0)
    assert leases.until_s == 13.0  # and nobody takes it from them


@pytest.mark.parametrize("name", ["LShoulderYaw", "LWristYaw"])
def test_a_hand_presses_the_drives_about_as_far_as_they_are_said_to_give_way(
    tmp_path: Path, name: str
) -> None:
    """From the limit on, the link of a joint with a gap leaning on its far side."""
    with lockstep_rig(write_robot(tmp_path / "arm")) as rig:
        joints, i = rig.robot.configuration.joints, rig.robot.configuration.joint_names.index(name)
        upper = joints[i].limits.upper
        pose = np.array([0.5 * (joint.limits.lower + joint.limits.upper) for joint in joints])
        pose[i] = upper - 0.1
        rig.arm.plant.place(pose)
        rig.enable()
        rig.tick.controller.motion.reference[i] = upper
        rig.run(1.5)
        rig.arm.external_torque[i] = strongest(joints[i])
        beyond = []
        rig.run(0.3, lambda: beyond.append(rig.arm.plant.q[i] - upper))
        assert 0.5 < max(beyond) / gives_way(rig.robot)[i] < 0.8


# --- a little of it -------------------------------------------------------------------------------


def test_the_lockstep_part_goes_the_same_way_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.soak.simulated.MEAN_PAUSE_S", 0.5)
    level = logging.getLogger("contactd").level
    runs = [run_lockstep(2, 2.5 / 3600.0) for _ in range(2)]
    assert logging.getLogger("contactd").level == level
    for part in runs:
        assert not part.ledger.broken, part.ledger.cases
        assert part.counts["enable done"] > 0
        assert any(what.startswith("fault: ") for what in part.counts)
    assert runs[0].counts == runs[1].counts
    assert runs[0].ledger.checked == runs[1].ledger.checked
    assert runs[0].samples["error of theta"] == runs[1].samples["error of theta"]


def test_a_hand_that_begins_within_a_tick_has_moved_the_arm_already(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A wrist that its drive holds in quick stop gives way at once: no motion of the arm's own."""

    def nobody_resets(rng: Random, c: Configuration) -> Person:
        yield Step()
        for command in ("enable", "start"):
            yield Step((Request(command),), wait_s=0.5)
        while True:
            yield Step()

    def push(rng: Random, c: Configuration, seconds: float) -> tuple[Push, ...]:
        return (Push(at_s=3.0, joint="LWristYaw", torque=0.4, duration_s=0.2),)

    over_heated = tuple(case for case in FAULTS if case.name == "over-temperature")
    monkeypatch.setattr("bench.soak.simulated.FAULTS", over_heated)
    monkeypatch.setattr("bench.soak.simulated.MEAN_PAUSE_S", 3.0)
    monkeypatch.setattr("bench.soak.simulated.hand_script", push)
    for who in ("operator", "program"):
        monkeypatch.setattr(f"bench.soak.simulated.{who}", nobody_resets)
    part = run_lockstep(9, 4.0 / 3600.0)  # whose only fault comes after a second
    assert part.counts["ticks faulted"] > 280, part.counts
    assert not part.ledger.broken, part.ledger.cases


def test_what_is_no_part_of_the_soak_is_a_fault_nevertheless() -> None:
    assert {case.name for case in CASES} >= UNFIT
    outside = {fault.__name__ for fault in outside_faults.FAULTS}
    assert outside >= {"sync_moved", "sync_lost", "mode_changed", "rpdo_off", "drive_restarts"}


def believes(watch: StopWatch, now: float, target: PowerTarget, seen: Seen | None) -> None:
    watch.proved = now > watch._now_s


@pytest.mark.parametrize(
    ("case", "broken", "rules"),
    [
        # Nothing but the setpoint, which a drive without SYNC never takes.
        (
            "SYNC moved by a tool (0x1005)",
            {"drivers.stop_stages.StopWatch.step": lambda self, now, target, seen: None},
            {"a stop is proved or the arm silent"},
        ),
        # What was told to stop is taken for standing a tick later.
        (
            "SYNC moved by a tool (0x1005)",
            {
                "drivers.stop_stages.StopWatch.step": believes,
                "drivers.expedited_stop.ExpeditedStop.request": lambda self, target: None,
            },
            {"no motion after a proved stop", "no joint goes further than is printed"},
        ),
        # A drive that stays in its fault is not set up anew.
        (
            "drive locked in 0x8130",
            {"daemon.service.set_up.SetUp.prove": lambda self: []},
            {"one reset is enough"},
        ),
    ],
)
def test_a_program_that_is_broken_breaks_a_rule(
    monkeypatch: pytest.MonkeyPatch, case: str, broken: dict[str, Any], rules: set[str]
) -> None:
    def resets(rng: Random, c: Configuration) -> Person:
        yield Step()
        while True:
            for command, wait_s in (("enable", 0.5), ("start", 4.5), ("reset", 1.0)):
                yield Step((Request(command),), wait_s=wait_s)

    def nobody(rng: Random, c: Configuration) -> Person:
        while True:
            yield Step()

    only = tuple(each for each in CASES if each.name == case)
    monkeypatch.setattr("bench.soak.simulated.FAULTS", only)
    monkeypatch.setattr("bench.soak.simulated.MEAN_PAUSE_S", 6.0)
    monkeypatch.setattr("bench.soak.simulated.hand_script", lambda *_: ())
    monkeypatch.setattr("bench.soak.simulated.operator", resets)
    monkeypatch.setattr("bench.soak.simulated.program", nobody)
    part = run_lockstep(9, 10.0 / 3600.0)
    assert not part.ledger.broken, part.ledger.cases
    for what, instead in broken.items():
        monkeypatch.setattr(what, instead)
    part = run_lockstep(9, 10.0 / 3600.0)
    assert rules <= set(part.ledger.broken), part.ledger.cases


def test_an_operator_has_wishes_in_every_mode() -> None:
    assert WISHES.keys() == set(Mode)
