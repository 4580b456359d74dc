"""Payload announced to the daemon behind its socket: shown, recorded, replayed, refused."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import SINGLE_JOINT
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from daemon.config.load import load_robot
from daemon.config.schema import PayloadEntry
from daemon.config.worst_loads import PayloadCapacity
from daemon.modes.table import Event, Mode
from daemon.protocol.requests import SetPayload
from daemon.protocol.state import State
from estimator.payload import Payload
from programs.clients.client import Client

CUP = PayloadEntry(mass=0.3, com=(0.2, 0.0, 0.1))


def test_a_payload_is_set_shown_and_removed(served: ServedDaemon) -> None:
    assert (
        served.contactctl("payload").stdout
        == "none; a payload announced before the daemon started is forgotten\n"
    )
    result = served.contactctl("payload", "0.4", "--com", "0.1", "0", "-0.05")
    assert (result.exit_code, result.stdout) == (0, "payload: 0.4 kg at (0.100 0.000 -0.050) m\n")
    shown = "0.4 kg at (0.100 0.000 -0.050) m of bar; forgotten when the daemon ends"
    assert served.contactctl("payload").stdout == shown + "\n"
    assert shown in served.contactctl("status").stdout
    served.run(0.05)
    state = served.rig.state()
    assert state.payload == Payload(mass=0.4, com=[0.1, 0.0, -0.05])
    assert served.contactctl("payload", "none").stdout == "payload: none\n"
    served.run(0.05)
    assert served.rig.state().payload is None


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["cup"], 1, "no payload 'cup' under `payloads` in config.yaml as last read; there"),
        (["-1"], 1, "-1 kg is not allowed: 0.001 to 100 kg; 0 for nothing"),
        (["nan"], 2, "nan is not a mass"),
        (["101"], 1, "0.001 to 100 kg"),
        (["0.4", "--com", "0", "nan", "0"], 2, "--com 0.0 nan 0.0 is not a place"),
        (["0,4"], 1, "a mass is a plain number, in kg"),
        (["1", "--com", "0", "0", "3"], 1, "centre of the payload (0 0 3) m"),
        (["cup", "--com", "0", "0", "0"], 2, "'cup' is a name"),
        (["--com", "0", "0", "0"], 2, "--com requires a mass"),
        (["cup", "--box", "1", "1", "1"], 2, "'cup' is a name"),
        (["--box", "1", "1", "1"], 2, "--box requires a mass"),
        (["1", "--box", "1", "nan", "1"], 2, "--box 1.0 nan 1.0 is not a size"),
        (["1", "--box", "0.1", "0", "0.1"], 1, "edges of 0.001 to 2 m"),
        (["1", "--box", "100", "100", "200"], 1, "edges of 0.001 to 2 m"),
        (["1", "--box", "0.1", "0.1", "0.1"], 1, "the arm has no shapes"),
        (["6"], 1, "too heavy: the motors can hold at most"),
    ],
)
def test_an_impossible_payload_is_refused(
    served: ServedDaemon, arguments: list[str], code: int, words: str
) -> None:
    result = served.contactctl("payload", *arguments)
    assert result.exit_code == code
    assert words in result.stderr
    assert served.rig.tick.payload is None


def test_contradicting_fields_are_refused(served: ServedDaemon, client: Client) -> None:
    for request, reason in (
        (SetPayload(), "it takes a `name`, or a `mass` with its `com`"),
        (SetPayload(name="none", mass=1.0), "it takes a `name`, or a `mass` with its"),
        (SetPayload(com=[0.0, 0.0, 0.0]), "it takes a `name`, or a `mass` with its `com`"),
        (SetPayload(mass=1.0, com=[0.0]), "three numbers"),
        (SetPayload(box=[0.1, 0.1, 0.1]), "it takes a `name`, or a `mass` with its `com`"),
        (SetPayload(name="none", box=[0.1, 0.1, 0.1]), "it takes a `name`, or a `mass` with its"),
        (SetPayload(mass=1.0, box=[0.1, 0.1]), "three edges"),
    ):
        reply = served.until(lambda asked=request: client.ask(asked))
        assert not reply.ok
        assert reason in reply.reasons[0]
    for given in ({"mass": 0.4, "name": "cup"}, {"com": [0.0, 0.0, 0.1]}, {"box": [0.1, 0.1, 0.1]}):
        reply = served.until(lambda given=given: client.payload(**given))
        assert not reply.ok


def test_the_advice_on_a_recognised_load(on: ServedDaemon, client: Client) -> None:
    rig = on.rig
    rig.request(Event.START)
    on.run(1.0)
    rig.request(Event.PAUSE)
    on.run(1.0)
    rig.tick.loads._recognition.found = Payload.of(0.4, rig.tick.estimator.model.tool_place)
    status = on.until(client.ask_status)
    assert status.recognised == "looks like a load of 0.4 kg at the hand: `contactctl payload 0.4`"
    assert status.advice.splitlines() == [
        "announce the payload of the hand (`contactctl payload 0.4`), or remove it",
        "`contactctl start` continues the trajectory",
    ]


def test_a_payload_is_refused_while_a_person_guides_the_arm(on: ServedDaemon) -> None:
    rig = on.rig
    on.run(1.0)
    assert not rig.permit()
    rig.arm.external_torque[0] = 3.0
    on.run(0.5)
    assert rig.mode is Mode.ADMITTANCE
    result = on.contactctl("payload", "0.1")
    assert result.exit_code == 1
    assert "the arm is being led: let go of it first" in result.stderr
    rig.arm.external_torque[0] = 0.0
    on.run(3.0)
    assert on.contactctl("payload", "0.1").exit_code == 0
    assert rig.tick.controller.machine.armed


def test_an_announced_load_is_no_contact(on: ServedDaemon) -> None:
    """0.5 kg at 0.2 m shows 1 Nm times the sine of its angle; announced, nothing."""
    rig = on.rig
    rig.request(Event.START)
    on.run(6.0)
    rig.arm.plant.carry(0.5, np.array([0.0, 0.0, -0.2]))
    place = np.array([0.0, 0.0, -0.2])

    def largest() -> float:
        found: list[float] = []
        for _ in range(500):
            on.tick()
            found.append(abs(float(rig.estimate.residual[0])))
        return max(found)

    untold = largest()
    answer = on.contactctl("payload", "0.5", "--com", *map(str, place))
    assert answer.exit_code == 0, answer.stderr
    on.run(0.5)
    assert largest() < 0.5 * untold


def test_names_come_from_the_configuration(tmp_path: Path) -> None:
    def configure(c):
        return msgspec.structs.replace(c, payloads={"cup": CUP})

    with served_daemon(tmp_path, configure=configure) as served:
        assert served.contactctl("payload", "cup").stdout.startswith("payload: cup: 0.3 kg at")
        assert "  cup: 0.3 kg at (0.200 0.000 0.100) m" in served.contactctl("payload").stdout
        assert "there are: cup" in served.contactctl("payload", "mug").stderr
        with Client(served.path) as program:
            assert served.until(lambda: program.payload(name="cup")).ok
            assert served.until(lambda: program.payload(0.2, (0.0, 0.0, 0.1))).ok
            assert served.until(program.payload).message == "payload: none"


def test_a_payload_is_too_heavy_just_beyond_the_motors_torque() -> None:
    """1 kg at 0.2 m and a motor of 12 Nm."""
    robot = load_robot(SINGLE_JOINT)
    capacity = PayloadCapacity(robot.configuration, robot.model)
    place = (0.0, 0.0, -0.3)
    reasons = capacity.too_heavy(Payload.of(20.0, place))
    assert "joint would need up to" in reasons[0]
    most = (12.0 / (9.81 * np.sin(1.4)) - 0.2) / 0.3
    assert not capacity.too_heavy(Payload.of(0.999 * most, place))
    assert capacity.too_heavy(Payload.of(1.001 * most, place))


def test_older_states_and_payloads_are_read() -> None:
    assert msgspec.json.decode(msgspec.json.encode({"mass": 1.0, "com": [0.0, 0.0, 0.0]}),
                               type=Payload).name == ""  # fmt: skip
    assert State.__struct_fields__.index("payload") > State.__struct_fields__.index("timing")


def test_a_payload_set_during_a_fault_stays_after_the_reset(on: ServedDaemon) -> None:
    """Also twice the same: what was learned of the model's errors begins anew, nothing else."""
    rig = on.rig
    on.run(0.5)
    rig.tick.controller.machine.apply(Event.FAULT, "the test", rig.time_s)
    on.run(0.2)
    assert rig.mode is Mode.FAULTED
    for _ in range(2):
        assert on.contactctl("payload", "0.3").exit_code == 0
    assert rig.mode is Mode.FAULTED
    assert on.contactctl("reset").exit_code == 0
    on.run(0.7)
    assert rig.mode is Mode.OFF
    rig.enable()
    on.run(0.5)
    assert rig.tick.payload is not None
    assert rig.tick.payload.mass == 0.3
    for _ in range(2):
        assert on.contactctl("payload", "none").exit_code == 0
    assert rig.tick.payload is None
