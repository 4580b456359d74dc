"""Files read anew by a running daemon, in lockstep: changed while off, while on, badly, half-way,
by two at once, and while a client records."""

import threading
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from bench.rigs.lockstep import SINGLE_JOINT
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from common.errors import ContactdError, ControlError
from contactd_client.client import Joined, Lost, watch
from daemon.modes.table import Mode
from daemon.protocol.state import Snapshot, State
from estimator.model import Model
from programs.clients import recorder
from programs.clients.client import Client
from programs.clients.log_reader import read_log
from programs.clients.reload import reload

Edit = Callable[[dict[str, Any]], None]


def edit(arm: Path, change: Edit) -> None:
    path = arm / "config.yaml"
    written = yaml.safe_load(path.read_text())
    change(written)
    path.write_text(yaml.safe_dump(written))


def softer(written: dict[str, Any]) -> None:
    written["joints"][0]["admittance_gain"] = 0.111


def gain_of(served: ServedDaemon) -> float:
    return served.service.process.robot.configuration.joints[0].admittance_gain


def bad_gear(written: dict[str, Any]) -> None:
    written["joints"][0]["wiring"]["gear"] = -100


def test_enable_takes_up_what_was_edited(served: ServedDaemon, arm: Path) -> None:
    edit(arm, softer)
    result = served.contactctl("enable")
    assert result.exit_code == 0
    assert result.stdout == "taking up config.yaml\nholding: drives enabled\n"
    assert gain_of(served) == 0.111
    assert served.contactctl("gain", "joint").stdout.split() == [
        "joint",
        "0.111",
        "rad/s",
        "per",
        "Nm",
    ]


MASSES = (
    "masses: {date: d, log: l, by_urdf: 0.3, by_this: 0.1, body: {mass: 1.1, com: [0, 0, -0.2], "
    "inertia: [0.02, 0, 0, 0.02, 0, 0.001]}}"
)


def test_a_reload_builds_no_model_twice(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    built: list[Model] = []
    build = Model.__init__

    def counted(model: Model, *parts: Any) -> None:
        built.append(model)
        build(model, *parts)

    monkeypatch.setattr(Model, "__init__", counted)
    edit(arm, lambda written: written.update(payloads={"cup": {"mass": 0.3}}))
    with served_daemon(arm.parent, arm) as served:
        assert built == [served.rig.robot.model] == [served.rig.tick.estimator.model]
        edit(arm, softer)
        assert served.contactctl("enable").exit_code == 0
        assert built[1:] == [served.rig.robot.model] == [served.rig.tick.estimator.model]
        assert served.contactctl("disable").exit_code == 0
        # With identified masses the arm is another than that of config.yaml, which is checked too.
        identified = arm / "identified.yaml"
        identified.write_text(identified.read_text().replace("gap: null", MASSES))
        assert served.contactctl("reload").exit_code == 0
        robot = served.rig.robot
        assert robot.by_hand is not None
        assert built[2:] == [robot.by_hand.model, robot.model]
        assert (built[2].mass, built[3].mass) == (1.0, 1.1)


def test_enable_of_a_program_is_refused_with_the_advice(served: ServedDaemon, arm: Path) -> None:
    edit(arm, softer)
    with Client(served.path) as client:
        reply = served.ask(client, "enable")
        assert reply.reasons == ["changed since it was read: config.yaml; `contactctl reload`"]
        # The very text of before is no change, whenever it was written.
        text = (SINGLE_JOINT / "config.yaml").read_text()
        (arm / "config.yaml").write_text(text)
        assert served.ask(client, "enable").ok


@pytest.mark.parametrize("name", ["identified.yaml", "config.yaml", "URDF", "EDS"])
def test_a_change_of_each_file_is_found(served: ServedDaemon, arm: Path, name: str) -> None:
    c = served.service.process.robot.configuration
    eds = next(iter(c.drives.values())).eds
    path = arm / {"URDF": c.urdf, "EDS": eds}.get(name, name)
    assert served.service.process.files.changed() == []
    path.write_text(path.read_text() + "\n" if path.exists() else "version: 1\n")
    changed = {"URDF": c.urdf, "EDS": eds}.get(name, name)
    assert served.service.process.files.changed() == [changed]
    found = served.contactctl("status").stdout
    assert f"changed since it was read: {changed}" in " ".join(found.split())
    assert served.contactctl("reload").stdout == f"reload: taken up: {changed}\n"
    assert served.service.process.files.changed() == []
    path.unlink()
    assert served.service.process.files.changed() == [changed], "gone is changed"


@pytest.mark.parametrize("ends", [b"\r", b"\r\r\n", b"\r\n"])
def test_line_ends_of_every_kind_are_read(served: ServedDaemon, arm: Path, ends: bytes) -> None:
    """A second reading finds no change, or no client could ever enable."""
    edit(arm, softer)
    path = arm / "config.yaml"
    path.write_bytes(path.read_bytes().replace(b"\n", ends))
    assert served.contactctl("enable").exit_code == 0
    assert served.service.process.files.changed() == []


def test_looking_for_changes_takes_little_memory(served: ServedDaemon, arm: Path) -> None:
    """In locked memory each page costs: 64 MB of them would cost the drives their heartbeat."""
    files = served.service.process.files
    edit(arm, softer)
    tracemalloc.start()
    try:
        assert files.changed() == ["config.yaml"]
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 1 << 20


def test_files_are_not_looked_at_while_the_drives_are_on(served: ServedDaemon, arm: Path) -> None:
    assert served.contactctl("enable").exit_code == 0
    edit(arm, softer)
    assert "changed since" not in served.contactctl("status").stdout
    assert served.contactctl("disable").exit_code == 0
    assert "changed since it was read: config.yaml" in served.contactctl("status").stdout


def test_a_reload_is_refused_while_the_drives_are_on(served: ServedDaemon, arm: Path) -> None:
    assert served.contactctl("enable").exit_code == 0
    edit(arm, softer)
    result = served.contactctl("reload")
    assert result.exit_code == 1
    assert "the drives must be off, not holding: `contactctl disable` first" in result.stderr
    assert served.rig.mode is Mode.HOLDING
    assert gain_of(served) != 0.111
    assert served.contactctl("arm").exit_code == 0, "it goes on as it is"
    assert served.contactctl("disable").exit_code == 0
    assert served.contactctl("reload").stdout == "reload: taken up: config.yaml\n"
    assert gain_of(served) == 0.111
    assert served.rig.mode is Mode.OFF


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda path: edit(path.parent, bad_gear), "wiring.gear: must be a number above 0"),
        (lambda path: path.write_text(path.read_text()[:700]), "config.yaml:"),  # half-way
        (lambda path: path.write_text(""), "config.yaml"),
        (lambda path: path.unlink(), "config.yaml"),
    ],
)
def test_a_broken_file_is_not_taken_up_and_nothing_is_enabled(
    served: ServedDaemon, arm: Path, spoil: Callable[[Path], None], words: str
) -> None:
    before = gain_of(served)
    text = (arm / "config.yaml").read_text()
    spoil(arm / "config.yaml")
    for command in ("reload", "enable"):
        result = served.contactctl(command)
        assert result.exit_code == 1
        assert "not taken up: " in result.stderr
        assert words in result.stderr
    with Client(served.path) as client:
        reply = served.ask(client, "enable")
    assert "not taken up: " in reply.reasons[0]
    assert served.rig.mode is Mode.OFF
    assert gain_of(served) == before
    assert "not taken up" in served.contactctl("status").stdout
    assert served.service.summary().startswith("off, not armed: started; not taken up: ")
    # Mended, it is taken up; as it was before, there is nothing to take up.
    (arm / "config.yaml").write_text(text)
    assert served.contactctl("enable").stdout == "holding: drives enabled\n"
    assert served.service.summary() == "holding, not armed: drives enabled"


def test_a_fault_is_reset_first(on: ServedDaemon) -> None:
    on.rig.tick.controller.machine.mode = Mode.FAULTED
    with Client(on.path) as client:
        reply = on.ask(client, "reload")
    assert reply.reasons == ["the drives must be off, not faulted: `contactctl reset` first"]


def test_two_reloads_at_once(served: ServedDaemon, arm: Path) -> None:
    edit(arm, softer)
    outcomes: list[str] = []

    def ask() -> None:
        try:
            outcomes.append(reload(served.path).mode)
        except ContactdError as error:
            outcomes.append(str(error))

    def both() -> None:
        threads = [threading.Thread(target=ask) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    served.until(both)
    assert Mode.OFF in outcomes
    assert len(outcomes) == 2
    assert gain_of(served) == 0.111
    assert served.contactctl("enable").exit_code == 0


def test_commands_during_a_reload_are_refused(served: ServedDaemon) -> None:
    with Client(served.path) as first, Client(served.path) as second:
        served.service.commands.reloading = True
        # As in the tick in which it was asked for.
        replies = []
        for client, command in ((first, "enable"), (second, "reload")):
            thread = threading.Thread(
                target=lambda c=client, w=command: replies.append(c.request(w))
            )
            thread.start()
            while thread.is_alive():
                served.rig.step()
                served.service.doors()
        assert [reply.reasons for reply in replies] == [["the daemon reads its files anew"]] * 2


def test_a_recording_ends_whole(served: ServedDaemon, arm: Path, tmp_path: Path) -> None:
    file = tmp_path / "states.mcap"
    begun = threading.Event()
    made: list[recorder.Recording] = []

    def record() -> None:
        made.append(recorder.record(lambda: Client(served.path), file, begun=begun.set))

    thread = threading.Thread(target=record)
    thread.start()
    while not begun.is_set():
        served.tick()
    served.run(0.5)
    edit(arm, softer)
    assert served.contactctl("reload").exit_code == 0
    served.until(thread.join)
    assert made[0].ended, "the daemon hung up"
    kinds = [type(message) for message in read_log(file)]
    assert kinds[0] is Snapshot
    assert kinds.count(State) == made[0].states > 40


def test_a_client_that_watches_reconnects_by_itself(served: ServedDaemon, arm: Path) -> None:
    """The page, the door to ROS 2 and programs follow so."""
    followed: list[str] = []

    def listen() -> None:
        for seen in watch(served.path, retry_s=0.01):
            match seen:
                case Joined():
                    followed.append("0.111" if "0.111" in seen.snapshot["configuration"] else "old")
                case Lost():
                    followed.append("lost")
            if followed[-1:] == ["0.111"]:
                return

    thread = threading.Thread(target=listen)
    thread.start()
    while "old" not in followed:
        served.tick()
    edit(arm, softer)
    assert served.contactctl("reload").exit_code == 0
    served.until(thread.join)
    assert (followed[0], followed[-1]) == ("old", "0.111")
    assert "lost" in followed


def test_a_refused_reload_is_an_error_to_a_program(served: ServedDaemon, arm: Path) -> None:
    edit(arm, bad_gear)
    with pytest.raises(ControlError, match=r"not taken up: .*gear"):
        served.until(lambda: reload(served.path))
