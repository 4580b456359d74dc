"""Fleet: arms that are alive, outcomes of a stop, and hostile messages without effect."""

import contextlib
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import zenoh
from click.testing import CliRunner, Result
from rich.console import Console

from programs.contactd import contactd
from programs.contactd.fleet import reported, table
from programs.zenoh.fleet import (
    MOST_ARMS,
    MOST_NAME,
    MOST_OF_ONE_NAME,
    MOST_TEXT,
    SILENT_S,
    Arm,
    Fleet,
    arm_of_token,
)
from programs.zenoh.messages import Diagnosis, Level, diagnostic_array, outcome
from programs.zenoh.names import Distro, Endpoint, Kind, Node, Qos
from programs.zenoh.services import TRIGGER
from programs.zenoh.supervisor import Supervisor
from tests.fake_daemon import running
from tests.programs.zenoh.bridge import Bridge, until
from tests.programs.zenoh.zenoh_router import session_at

NODE = Node(0, "/left_arm", "contactd", Distro.JAZZY, "abc")

TOKENS = [
    (NODE.token(), "left_arm"),
    (Node(0, "/hall/a_2", "contactd", Distro.JAZZY, "abc").token(), "hall/a_2"),
    (Node(0, "/left_arm", "planner", Distro.JAZZY, "abc").token(), ""),
    (Node(0, "/", "contactd", Distro.JAZZY, "abc").token(), ""),
    (Node(1, "/left_arm", "contactd", Distro.JAZZY, "abc").token(), ""),
    (NODE.token().replace("/NN/", "/MP/"), ""),
    (NODE.token() + "/more", ""),
    ("@ros2_lv/0/abc/0/0/NN/%/%left\x1b[2Jarm/contactd", ""),
    ("nonsense", ""),
]


@pytest.mark.parametrize(("token", "name"), TOKENS)
def test_only_nodes_of_contactd_are_arms(token: str, name: str) -> None:
    assert arm_of_token(token, 0) == name


def said(name: str = "contactd: left_arm", text: str = "holding: start") -> Diagnosis:
    return Diagnosis(Level.OK, name, text, values=(("mode", "holding"), ("armed", "true")))


@pytest.mark.parametrize(
    ("arm", "reports_s", "waited_s"),
    [
        (Arm("held_up", frozenset("a")), 4.2, 4.5),
        (Arm("in_time", frozenset("a")), 1.0, 1.5),
        (Arm("silent", frozenset("a")), 100.0, 8.0),
        (Arm("gone"), 100.0, 1.5),
    ],
)
def test_the_wait_for_an_arm_ends(arm: Arm, reports_s: float, waited_s: float) -> None:
    clock_s = [0.0]
    found = reported(
        lambda: [replace(arm, mode="holding") if clock_s[0] >= reports_s else arm],
        lambda: clock_s[0],
        lambda s: clock_s.append(clock_s.pop() + s),
    )
    assert clock_s[0] == pytest.approx(waited_s)
    assert bool(found[0].mode) == (reports_s < 8.0)


def test_an_arms_diagnosis_and_the_duration_of_its_silence_are_kept() -> None:
    fleet = Fleet()
    fleet.meet("left_arm", True, "abc")
    assert fleet.arms["left_arm"].silent_s(5.0) is None  # it has just come
    fleet.on_diagnostics(
        [said(), said("contactd: left_arm: LElbowRoll"), said("battery: left_arm")], 10.0
    )
    assert set(fleet.arms) == {"left_arm"}
    arm = fleet.arms["left_arm"]
    assert (arm.mode, arm.armed, arm.text) == ("holding", "true", "holding: start")
    assert arm.silent_s(10.0 + SILENT_S) is None
    assert arm.silent_s(10.1 + SILENT_S) == pytest.approx(SILENT_S + 0.1)
    fleet.meet("left_arm", False, "abc")
    assert fleet.arms["left_arm"].silent_s(10.5) == pytest.approx(0.5)


def test_an_arm_is_alive_as_long_as_one_node_of_its_name_is() -> None:
    """One that begins anew is met before the router has noticed that the one before is gone."""
    fleet = Fleet()
    for zid in ("old", "new"):
        fleet.meet("left_arm", True, zid)
    fleet.on_diagnostics([said()], 1.0)
    assert fleet.arms["left_arm"].state(1.0) == "alive, 2 of this name"
    fleet.meet("left_arm", False, "old")
    fleet.meet("left_arm", False, "old")
    assert fleet.arms["left_arm"].state(1.0) == "alive"
    fleet.meet("left_arm", False, "new")
    assert fleet.arms["left_arm"].state(2.0) == "silent for 1 s"


def test_a_stranger_fills_neither_memory_nor_terminal() -> None:
    fleet = Fleet()
    for i in range(2 * MOST_ARMS):
        fleet.meet(f"arm_{i}", True, "abc")
        fleet.on_diagnostics([said(f"contactd: other_{i}")], 1.0)
    assert len(fleet.arms) == MOST_ARMS
    for i in range(2 * MOST_OF_ONE_NAME):
        fleet.meet("arm_0", True, f"node {i}")
    assert len(fleet.arms["arm_0"].nodes) == MOST_OF_ONE_NAME
    fleet.on_diagnostics(
        [said("contactd: arm_0", "\x1b[2J" + "x" * 10_000), said("contactd: a*b")], 1.0
    )
    assert "a*b" not in fleet.arms
    assert fleet.arms["arm_0"].text == "?[2J" + "x" * (MOST_TEXT - 4)
    fleet.touch(Diagnosis(Level.WARN, "j", "contact\n", "arm_1"))
    fleet.touch(Diagnosis(Level.WARN, "j", "contact", "*"))
    known = set(fleet.arms)
    fleet.arms.pop("arm_2")  # so that there is room
    long = "a" * (MOST_NAME + 1)
    assert arm_of_token(Node(0, f"/{long}", "contactd", Distro.JAZZY, "abc").token(), 0) == ""
    fleet.on_diagnostics([said(f"contactd: {long}")], 1.0)
    fleet.touch(Diagnosis(Level.WARN, "j", "contact", long))
    assert set(fleet.arms) == known - {"arm_2"}
    assert fleet.arms["arm_1"].contact == "contact?"


def test_an_arm_that_is_alive_finds_room_among_names_that_came_and_went() -> None:
    fleet = Fleet()
    fleet.meet("left_arm", True, "node")
    for i in range(2 * MOST_ARMS):
        fleet.meet(f"ghost_{i}", True, "node")
        fleet.meet(f"ghost_{i}", False, "node")
    fleet.meet("right_arm", True, "node")
    assert len(fleet.arms) == MOST_ARMS
    assert {arm.name for arm in fleet.arms.values() if arm.alive} == {"left_arm", "right_arm"}


def test_the_table_shows_text_as_text() -> None:
    console = Console(width=120, record=True, file=None, quiet=False)
    arm = Arm(
        "left_arm", frozenset({"abc"}), 1.0, Level.ERROR, "[red]faulted[/red]", "faulted", "false"
    )
    with console.capture() as captured:
        console.print(table([arm], 10.0))
    assert "[red]faulted[/red]" in captured.get()
    assert "silent for 9 s" in captured.get()


# --- with arms ---------------------------------------------------------------------------------


@pytest.fixture
def second(fake_daemon: Any, tmp_path: Path) -> Iterator[Any]:
    """Another daemon."""
    (tmp_path / "second").mkdir()
    with running(type(fake_daemon)(tmp_path / "second/control")) as daemon:
        yield daemon


@pytest.fixture
def arms(
    fake_daemon: Any, second: Any, routed: int, start: Callable[..., Bridge], other: zenoh.Session
) -> list[Bridge]:
    both = [start(fake_daemon.path, routed, "left"), start(second.path, routed, "right")]
    for bridge in both:
        bridge.joined()
        name = bridge.node.absolute("stop")
        key = bridge.node.key(Endpoint(Kind.SERVICE, name, TRIGGER, Qos.DEFAULT))
        until(lambda key=key: list(other.get(key, payload=b"none")))  # it is refused
    return both


@pytest.fixture
def fleet(routed: int) -> Callable[..., Result]:
    def call(*words: str) -> Result:
        command = ["fleet", "--connect", f"tcp/127.0.0.1:{routed}", *words]
        return CliRunner().invoke(contactd.main, command, catch_exceptions=False)

    return call


def stops(daemon: Any) -> int:
    return [command for command, _ in daemon.seen].count("stop")


def test_arms_are_shown(arms: list[Bridge], fleet: Callable[..., Result]) -> None:
    def rows_once_heard() -> dict[str, Any]:
        shown = fleet("--json")
        rows = {row["arm"]: row for row in json.loads(shown.output)}
        return rows if set(rows) == {"left", "right"} and rows["left"]["mode"] else {}

    rows = until(rows_once_heard)
    assert rows["left"]["alive"]
    assert rows["left"]["mode"] in ("tracking", "admittance")
    assert rows["left"]["armed"] is True
    assert "right" in fleet().output


def test_one_arm_is_stopped(
    arms: list[Bridge], fleet: Callable[..., Result], fake_daemon: Any, second: Any
) -> None:
    done = fleet("--stop", "right")
    assert (done.exit_code, done.output.split()) == (0, ["right", "stands"])
    assert (stops(fake_daemon), stops(second)) == (0, 1)


def test_arms_of_one_name_stand_only_if_both_do(
    fake_daemon: Any, second: Any, routed: int, start: Any, fleet: Callable[..., Result]
) -> None:
    bridges = [start(daemon.path, routed, "left") for daemon in (fake_daemon, second)]
    for bridge in bridges:
        bridge.joined()
    warning = "another contactd-zenoh has --namespace /left:"
    until(lambda: any(bridge.heard(warning) for bridge in bridges))
    until(lambda: "alive, 2 of this name" in fleet("--json").output)
    fleet("--stop", "left")
    until(lambda: fleet("--stop", "left").exit_code == 0)
    assert stops(fake_daemon) == stops(second) > 0
    for one, both in ((second, "left"), (fake_daemon, "--all")):
        one.unproved = ["LElbowRoll"]
        done = fleet("--stop", both)
        assert done.exit_code == 1
        assert f"{'left':24} not seen to stand (not seen to stand: LElbow" in done.output
        one.unproved = []


def test_all_arms_are_stopped_and_each_outcome_is_shown(
    arms: list[Bridge], fleet: Callable[..., Result], fake_daemon: Any, second: Any
) -> None:
    done = fleet("--stop", "--all", "--json")
    assert done.exit_code == 0
    stands = {"outcome": "stands", "text": "stands"}
    assert json.loads(done.output) == {"left": stands, "right": stands}
    assert (stops(fake_daemon), stops(second)) == (1, 1)
    second.unproved = ["LElbowRoll"]
    done = fleet("--stop", "--all")
    assert done.exit_code == 1
    assert f"{'right':24} not seen to stand (not seen to stand: LElbowRoll)" in done.output
    second.stopped.set()
    done = fleet("--stop", "left", "right", "absent")
    assert done.exit_code == 1
    lines = dict(line.split(None, 1) for line in done.output.splitlines())
    assert lines["left"].startswith("stands")
    assert lines["right"].startswith("not seen to stand (not reached: ")
    assert lines["absent"] == "no answer"


def test_no_arm_and_no_router_are_reported(fleet: Callable[..., Result], port: int) -> None:
    assert fleet().exit_code == 69
    no_one = fleet("--stop", "--all")
    assert (no_one.exit_code, no_one.output) == (69, "contactd: no arm is alive at this router\n")
    command = ["fleet", "--connect", "tcp/127.0.0.1:1", "--stop", "--all"]
    unreachable = CliRunner().invoke(contactd.main, command)
    assert unreachable.exit_code == 69
    assert "contactd: no router at tcp/127.0.0.1:1: " in unreachable.output
    assert unreachable.output.endswith(" (docs/ros.md)\n")
    unread = CliRunner().invoke(contactd.main, ["fleet", "--config", "/nowhere"])
    assert unread.exit_code == 78
    assert "contactd: /nowhere: refused by Zenoh: " in unread.output


WRONG = [("left",), ("--stop",), ("--stop", "--all", "left"), ("--watch", "--json"), ("--all",)]


@pytest.mark.parametrize("words", WRONG)
def test_contradictory_options_are_refused(words: tuple[str, ...]) -> None:
    result = CliRunner().invoke(contactd.main, ["fleet", *words])
    assert result.exit_code == 2
    assert "--watch, --stop ARM..., or --stop --all" in result.output


def test_arms_of_another_distribution_are_listed_without_messages(
    arms: list[Bridge], fleet: Callable[..., Result]
) -> None:
    def rows() -> Any:
        return json.loads(fleet("--json", "--distro", "humble").output)

    until(lambda: [row["arm"] for row in rows()] == ["left", "right"])
    assert {row["text"] for row in rows()} == {"no message yet; does it use another --distro?"}


def test_a_router_that_dies_leaves_arms_silent_and_comes_back(
    fake_daemon: Any, port: int, start: Callable[..., Bridge]
) -> None:
    where = f"tcp/127.0.0.1:{port}"
    opened = session_at(where, "router")
    start(fake_daemon.path, port)
    with (
        contextlib.closing(session_at(where, "client")) as session,
        Supervisor(session, 0, Distro.JAZZY) as supervisor,
    ):
        until(lambda: [arm for arm in supervisor.arms() if arm.alive and arm.heard_s])
        opened.close()
        until(lambda: not supervisor.arms()[0].alive)
        assert supervisor.stop(["left_arm"])["left_arm"] == ("no answer", "")
        opened = session_at(where, "router")
        until(lambda: supervisor.arms()[0].alive)
        assert until(lambda: supervisor.stop(["left_arm"])["left_arm"][0] == "stands")
    opened.close()


def test_a_hostile_answer_does_not_confirm_standstill(other: zenoh.Session, routed: int) -> None:
    """Answers on an arm's behalf, and what is no message."""
    answers = iter([b"", b"\0\1\0\0", outcome(False, "\x1b[2J"), None])

    def reply(query: zenoh.Query) -> None:
        answer = next(answers)
        query.reply_err("no") if answer is None else query.reply(query.key_expr, answer)

    service = Endpoint(Kind.SERVICE, "/left_arm/stop", TRIGGER, Qos.DEFAULT)
    other.declare_queryable(NODE.key(service), reply)
    kind = "diagnostic_msgs/msg/DiagnosticArray"
    diagnostics = Endpoint(Kind.PUBLISHER, "/diagnostics", kind, Qos.DEFAULT)
    with (
        contextlib.closing(session_at(f"tcp/127.0.0.1:{routed}", "client")) as session,
        Supervisor(session, 0, Distro.JAZZY) as supervisor,
    ):
        found = [supervisor.stop(["left_arm"])["left_arm"] for _ in range(4)]
        for payload in (b"", b"\xff" * 1000, b"\0\1\0\0" + b"\xff" * 1_000_000):
            other.put(NODE.key(diagnostics), payload)

        def heard_later() -> bool:
            other.put(NODE.key(diagnostics), diagnostic_array(1.0, [said("contactd: later")]))
            return "later" in [arm.name for arm in supervisor.arms()]

        until(heard_later)  # a message may find no room behind a large one
    assert [what for what, _ in found] == ["not seen to stand"] * 4
    assert found[2][1] == "?[2J"


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("programs.zenoh")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "zenoh", None)
    result = CliRunner().invoke(contactd.main, ["fleet"])
    assert result.exit_code == 78
    assert result.output == (
        "contactd: `fleet` needs the extra `ros` (zenoh): pip install 'contactd[ros]'\n"
    )


def test_two_arms_of_one_name_are_both_stopped(routed: int) -> None:
    """As without namespaces; the answer of one does not count for the other."""
    node = Node(0, "/left", "contactd", Distro.JAZZY)
    key = node.key(Endpoint(Kind.SERVICE, node.absolute("stop"), TRIGGER, Qos.DEFAULT))
    asked: set[bool] = set()

    def answers(stands: bool) -> Callable[[zenoh.Query], None]:
        def take(query: zenoh.Query) -> None:
            asked.add(stands)
            query.reply(query.key_expr, outcome(stands, "what it says"))
            query.drop()

        return take

    with contextlib.ExitStack() as opened:
        at = f"tcp/127.0.0.1:{routed}"
        for stands in (True, False):
            session = opened.enter_context(contextlib.closing(session_at(at, "client")))
            session.declare_queryable(key, answers(stands), complete=True)
        session = opened.enter_context(contextlib.closing(session_at(at, "client")))
        fleet = opened.enter_context(Supervisor(session, 0, Distro.JAZZY))
        until(lambda: list(session.get(key, target=zenoh.QueryTarget.ALL)) and len(asked) == 2)
        for _ in range(3):
            asked.clear()
            assert fleet.stop(["left"]) == {"left": ("not seen to stand", "what it says")}
            until(lambda: asked == {True, False})  # one answer is enough to end it
