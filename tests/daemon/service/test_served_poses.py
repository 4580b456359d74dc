"""Poses that the daemon is asked to go to through its socket, in lockstep with a simulated arm."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import ROMEO
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from daemon.config.load import load_robot
from daemon.config.schema import Configuration
from daemon.modes.table import Event, Mode
from daemon.protocol.replies import Check, PlannedPath, Status, Trajectory
from daemon.protocol.requests import Go, Request, Stop
from daemon.service.poses import Poses
from daemon.service.status import ASK_AGAIN
from programs.clients.client import Client
from programs.contactctl import go as command

POSES = {"home": {"joint": 0.3}, "far": {"joint": 1.2}}


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ServedDaemon]:
    """With poses. Commands run in a thread here, which gets no signals: no one interrupts."""
    monkeypatch.setattr(command, "_interrupted", _no_one)

    def with_poses(c: Configuration) -> Configuration:
        return msgspec.structs.replace(c, poses=POSES)

    with served_daemon(tmp_path, configure=with_poses) as served:
        yield served


class _no_one:  # noqa: N801 - in place of a function
    def __enter__(self) -> object:
        return lambda: False

    def __exit__(self, *_: object) -> None: ...


def stands(served: ServedDaemon) -> float:
    return float(served.rig.samples.link_position[0])


@pytest.mark.parametrize(
    ("words", "goal"), [(["home"], 0.3), (["go", "home"], 0.3), (["go", "joint=-0.25"], -0.25)]
)
def test_go_moves_to_a_pose_and_prints_it(on: ServedDaemon, words: list[str], goal: float) -> None:
    began = stands(on)
    result = on.contactctl(*words, "--yes")
    assert result.exit_code == 0, result.stderr
    head, table, _, warning, end = result.stdout.splitlines()
    assert head.split() == ["from", "to", "distance", "speed", "time"]
    figures = [float(word) for word in table.removesuffix(" s").split()[1:]]
    assert figures[:4] == pytest.approx([began, goal, goal - began, 0.2], abs=2e-3)
    assert warning == command.NO_COLLISION_CHECK
    assert end.startswith("holding: the way to ")
    on.run(0.3)
    assert stands(on) == pytest.approx(goal, abs=0.01)


@pytest.mark.parametrize(
    ("shapes", "words"), [(True, command.SHAPES_CHECKED), (False, command.NO_COLLISION_CHECK)]
)
def test_the_printed_motion_ends_with_what_is_checked(shapes: bool, words: str) -> None:
    way = PlannedPath(
        name="home", joints=["joint"], start=[0.0], goal=[0.3], speed=[0.2], duration_s=2.0,
        shapes=shapes,
    )  # fmt: skip
    assert command.in_words(way).splitlines()[-1] == words


def test_the_planned_time_and_speed_are_kept(on: ServedDaemon) -> None:
    reply = on.until(lambda: _ask(on, Go(pose="home", speed=0.1)))
    assert reply.way is not None
    begun, where = on.rig.time_s, []
    while on.rig.mode is Mode.TRACKING:
        on.tick()
        where.append(float(on.rig.decision.reference[0]))
    assert on.rig.time_s - begun == pytest.approx(reply.way.duration_s, abs=0.1)
    period_s = on.rig.robot.configuration.period_s
    assert np.abs(np.diff(where)).max() / period_s == pytest.approx(max(reply.way.speed), rel=0.1)


def test_a_plan_moves_nothing(on: ServedDaemon) -> None:
    reply = on.until(lambda: _ask(on, Go(pose="far", plan=True)))
    assert reply.ok
    assert (reply.message, reply.way.goal) == ("go: planned", [1.2])
    on.run(0.2)
    assert on.rig.mode is Mode.HOLDING


def test_poses_are_listed(served: ServedDaemon) -> None:
    assert served.contactctl("go").stdout.split() == ["home", "joint=0.3", "far", "joint=1.2"]
    assert json.loads(served.contactctl("go", "--json").stdout) == POSES


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["go", "nowhere", "--yes"], 1, "no pose 'nowhere' under `poses` in config.yaml as last r"),
        (["go", "joint", "--yes"], 1, "JOINT=VALUE is expected, with its position in rad, such as"),
        (["go", "elbow=1", "--yes"], 1, "no joint 'elbow'; there are: joint"),
        (["go", "joint=1.5", "--yes"], 1, "joint=1.5 is outside its limits [-1.4, 1.4] rad"),
        (["go", "joint=x", "--yes"], 2, "'x' is not a position in rad"),
        (["go", "joint=nan", "--yes"], 2, "'nan' is not a position in rad"),
        (["go", "joint=inf", "--yes"], 2, "'inf' is not a position in rad"),
        (["go", "=1", "--yes"], 2, "give either one POSE or JOINT=VALUE for each joint"),
        (["go", "home", "joint=1", "--yes"], 2, "'home': give either one POSE"),
        (["go", "joint=1", "joint=1", "--yes"], 2, "joint is given twice"),
        (["go", "--yes"], 2, "to which POSE, or JOINT=VALUE?"),
        (["go", "", "--yes"], 2, "'': give either one POSE or JOINT=VALUE for each joint"),
        (["go", "home"], 2, "--yes skips it"),
        (["go", "elbow=1"], 1, "no joint 'elbow'; there are: joint"),
        (["go", "home", "--json"], 2, "--yes skips it"),
        (["go", "home", "--yes", "--speed", "0"], 2, "not in the range 0.001<=x<=2"),
        (["go", "home", "--yes", "--speed", "2.1"], 2, "not in the range"),
        (["go", "home", "--yes", "--speed", "nan"], 2, "not in the range"),
    ],
)
def test_an_invalid_go_is_refused(on: ServedDaemon, words: list[str], code: int, text: str) -> None:
    result = on.contactctl(*words)
    assert result.exit_code == code
    assert text in result.stderr
    assert on.rig.mode is Mode.HOLDING


@pytest.mark.parametrize(
    ("request_", "reason"),
    [
        (Go(), "it takes either a `pose` or `targets`"),
        (Go(targets={}), "it takes either a `pose` or `targets`"),
        (Go(pose="home", targets={"joint": 0.0}), "either a `pose` or `targets`"),
        (Go(pose="home", planned_from=[]), "`planned_from` has 0 joints instead of 1"),
        (Go(pose="home", planned_from=[0.9]), "has moved since this was planned"),
    ],
)
def test_an_invalid_request_is_refused(on: ServedDaemon, request_: Request, reason: str) -> None:
    reply = on.until(lambda: _ask(on, request_))
    assert not reply.ok
    assert reason in reply.reasons[0]
    assert on.rig.mode is Mode.HOLDING


def test_off_and_under_way_it_is_refused(served: ServedDaemon) -> None:
    result = served.contactctl("home", "--yes")
    assert "the drives are off (`contactctl enable` first)" in result.stderr
    served.rig.enable()
    assert served.contactctl("start").exit_code == 0
    result = served.contactctl("home", "--yes")
    assert "the trajectory is running (`contactctl pause` or `stop` first)" in result.stderr
    served.contactctl("stop")


@pytest.mark.parametrize("name", ["identification", "parameters"])
def test_an_arm_that_is_not_identified_stays(on: ServedDaemon, name: str) -> None:
    checks = on.rig.arming
    checks._settled = (Check(name=name, passed=False, text="gap of joint is not known"),)
    result = on.contactctl("home", "--yes")
    assert result.exit_code == 1
    assert "gap of joint is not known" in result.stderr
    assert on.rig.mode is Mode.HOLDING


def test_a_contact_halts_the_motion_and_the_command_reports_it(on: ServedDaemon) -> None:
    ask = Go(pose="far")
    assert on.until(lambda: _ask(on, ask)).ok
    on.run(1.5)
    assert on.rig.mode is Mode.TRACKING
    on.rig.arm.external_torque[0] = -3.0
    on.run(0.5)
    on.rig.arm.external_torque[0] = 0.0
    assert on.rig.mode in (Mode.STOPPING, Mode.HOLDING)
    assert not on.rig.tick.controller.machine.armed
    on.run(1.5)
    assert on.rig.mode is Mode.HOLDING
    way = on.until(lambda: _ask(on, Go(pose="far", plan=True))).way
    ended = on.until(lambda: _waited(on, way))
    assert not ended.ok
    assert ended.message.startswith("not arrived: holding, contact of ")
    assert ended.reasons == ["`contactctl start` continues the trajectory"]
    assert on.contactctl("start").exit_code == 0
    while on.rig.mode is Mode.TRACKING:
        on.tick()
    assert on.until(lambda: _waited(on, way)).ok


def test_go_to_a_limit_warns_of_the_gap(on: ServedDaemon) -> None:
    result = on.contactctl("go", "joint=-1.4", "--yes")
    assert result.exit_code == 1
    warning, end, where = result.stderr.splitlines()
    assert "warning: joint may stop up to 0.200 rad short of -1.400" in warning
    assert end.endswith("not arrived: holding, the way to joint=-1.4 came to its end")
    assert re.fullmatch(r"  - joint is at -1.2\d\d rad, 0.1\d\d rad from -1.400", where)


def test_interrupted_it_stops(served: ServedDaemon, monkeypatch: pytest.MonkeyPatch) -> None:
    class AtOnce(_no_one):
        def __enter__(self) -> object:
            return lambda: served.rig.mode is Mode.TRACKING and stands(served) > 0.5

    monkeypatch.setattr(command, "_interrupted", AtOnce)
    served.rig.enable()
    result = served.contactctl("go", "far", "--yes")
    assert result.exit_code == 1
    assert result.stdout.splitlines()[-1].startswith("holding: stop by uid")
    assert 0.5 < stands(served) < 0.7


def test_a_motion_stopped_by_another_client_is_reported_as_not_arrived(on: ServedDaemon) -> None:
    way = on.until(lambda: _ask(on, Go(pose="far"))).way
    on.run(2.0)
    assert on.until(lambda: _ask(on, Stop())).ok
    ended = on.until(lambda: _waited(on, way))
    assert not ended.ok
    assert ended.message.startswith("not arrived: holding, stop by")


def test_the_advice_of_a_refused_start_leads_there(on: ServedDaemon, tmp_path: Path) -> None:
    path = tmp_path / "move.csv"
    path.write_text("time_s,joint\n0,0.8\n1,0.8\n3,1.0\n")
    refused = on.contactctl("start", str(path))
    words = re.search(r"`contactctl (go [^`]+)` leads there", refused.stderr)
    assert words is not None, refused.stderr
    assert on.contactctl(*words[1].split(), "--yes").exit_code == 0
    assert on.contactctl("start", str(path)).exit_code == 0
    assert on.rig.mode is Mode.TRACKING
    on.contactctl("stop")


def _ask(served: ServedDaemon, request: Request):
    with Client(served.path) as client:
        return client.ask(request)


def _waited(served: ServedDaemon, way: object):
    with Client(served.path) as client:
        return command._wait(client, way, lambda: False)


# --- clients that attend a motion, and end before it -----------------------------------------


def sets_out(served: ServedDaemon, client: Client, *, attended: bool) -> None:
    served.rig.enable()
    reply = served.until(lambda: client.go("far", attended=attended))
    assert reply.ok, reply
    served.run(1.0)
    assert served.rig.mode is Mode.TRACKING


@pytest.fixture
def attending(served: ServedDaemon) -> Iterator[Client]:
    """Client whose motion to `far` has begun; a test may close it."""
    with Client(served.path) as client:
        sets_out(served, client, attended=True)
        yield client


def cause(served: ServedDaemon) -> str:
    return served.rig.tick.controller.machine.cause


def halted(served: ServedDaemon) -> str:
    """Cause of the halt of an arm that holds 0.3 s from now."""
    causes = []
    for _ in range(30):
        served.tick()
        causes.append(cause(served))
    assert served.rig.mode is Mode.HOLDING
    return next(text for text in causes if text.startswith("abandon"))


def trajectory(served: ServedDaemon) -> Trajectory:
    with Client(served.path) as client:
        status = served.until(client.ask_status)
    assert isinstance(status, Status)
    return status.trajectory


def starts_the_configured(served: ServedDaemon) -> bool:
    """True where the next `start` runs the configured trajectory from its beginning, as `status`
    announces."""
    controller = served.rig.tick.controller
    configured, shown = controller._configured.path, trajectory(served)
    assert (shown.name, shown.state, shown.time_s) == (configured.name, "ready", 0.0)
    assert served.contactctl("start").exit_code == 0
    return controller.motion.follower.place.path is configured


def test_a_closed_client_halts_its_motion(served: ServedDaemon, attending: Client) -> None:
    assert trajectory(served).attended
    attending.close()
    assert halted(served) == "abandon by the daemon: its client is gone; its motion is forgotten"
    assert stands(served) < 1.0
    assert starts_the_configured(served)


@pytest.mark.parametrize("event", [Event.PAUSE, Event.HALT])
def test_a_motion_halted_before_its_client_closes_is_forgotten(
    served: ServedDaemon, attending: Client, event: Event
) -> None:
    """As after Ctrl-C of a step of the identification, or a contact."""
    served.rig.tick.controller.apply_event(event, "before", served.rig.time_s)
    served.run(0.5)
    paused = trajectory(served)
    assert (paused.state, paused.attended) == ("paused", True)
    assert served.until(attending.ask_status).advice == ASK_AGAIN
    attending.close()
    served.run(0.1)
    gone = "abandon by the daemon: its client is gone; its motion is forgotten"
    assert cause(served) == f"before; {gone}"
    assert starts_the_configured(served)


def test_a_closed_client_leaves_a_guided_arm(served: ServedDaemon, attending: Client) -> None:
    machine = served.rig.tick.controller.machine
    machine.arm("the test")
    served.rig.tick.controller.apply_event(Event.TOUCH, "a touch", served.rig.time_s)
    assert machine.moving
    attending.close()
    served.tick()
    assert (machine.mode, machine.armed) == (Mode.ADMITTANCE, True)
    assert (machine.moving, machine.paused) == (False, False)


def test_a_motion_is_halted_when_its_client_is_silent(served: ServedDaemon) -> None:
    served.service.commands.attendance.silent_s = 2.0
    with Client(served.path) as client:
        sets_out(served, client, attended=True)
        served.until(client.ask_status)
        served.run(1.9)
        assert served.rig.mode is Mode.TRACKING
        silent = "its client has been silent for 2 s; its motion is forgotten"
        assert halted(served) == f"abandon by the daemon: {silent}"
        assert starts_the_configured(served)


def test_a_motion_without_an_attending_client_goes_on(served: ServedDaemon) -> None:
    served.service.commands.attendance.silent_s = 2.0
    with Client(served.path) as client:
        sets_out(served, client, attended=False)
    served.run(2.5)
    assert served.rig.mode is Mode.TRACKING


def test_a_start_by_another_keeps_the_client(served: ServedDaemon, attending: Client) -> None:
    served.contactctl("pause")
    served.contactctl("start")
    served.run(0.2)
    assert served.rig.mode is Mode.TRACKING
    assert trajectory(served).attended
    attending.close()
    served.run(0.2)
    assert served.rig.mode is not Mode.TRACKING
    assert starts_the_configured(served)


def test_another_later_motion_is_not_halted(served: ServedDaemon, attending: Client) -> None:
    with Client(served.path) as other:
        served.contactctl("pause")
        assert served.until(lambda: other.go("home")).ok
        served.run(0.2)
    attending.close()
    served.run(0.2)
    assert served.rig.mode is Mode.TRACKING


def test_a_closed_client_keeps_the_cause_of_an_end(served: ServedDaemon, attending: Client) -> None:
    while served.rig.mode is Mode.TRACKING:
        served.tick()
    attending.close()
    served.run(0.1)
    assert (served.rig.mode, cause(served)) == (Mode.HOLDING, "the way to far came to its end")


def test_contactctl_attends_its_motion(on: ServedDaemon, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Request] = []
    ask = Client.ask
    monkeypatch.setattr(Client, "ask", lambda self, r: (asked.append(r), ask(self, r))[1])
    assert on.contactctl("home", "--yes").exit_code == 0
    assert [request.attended for request in asked if request.command == "go"] == [False, True]


def test_a_pose_of_many_joints_is_named_by_their_number() -> None:
    robot = load_robot(ROMEO)
    q, names = np.zeros(7), robot.configuration.joint_names
    for few, name in ((2, "the way to LShoulderPitch=0.1235 LShoulderYaw=0.1235"), (3, "3 joints")):
        path = Poses(robot).path(Go(targets=dict.fromkeys(names[:few], 0.123456)), q)
        assert name in path.name
