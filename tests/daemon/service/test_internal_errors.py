"""Requests that break inside the program: one answer, one entry in the log, an arm that goes on
ticking and is no more willing to move."""

import logging
from collections.abc import Callable
from typing import Any

import pytest

from bench.rigs.served_daemon import ServedDaemon
from daemon.modes.table import ENERGISED, Event, Mode
from daemon.protocol.requests import STILLING, SetPayload, bare
from daemon.service.commands import Commands
from daemon.service.internal_errors import Checkpoint, error_in_words, remedy
from daemon.tick.controller import Controller
from daemon.tick.tick import Tick
from programs.clients.client import Client

BROKEN = "internal error: ZeroDivisionError: on purpose; see the daemon's log"


def breaks(*_: object, **__: object) -> Any:
    raise ZeroDivisionError("on purpose")


def breaking_after(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, which breaks when its work is done."""

    def work(*arguments: Any, **more: Any) -> Any:
        function(*arguments, **more)
        return breaks()

    return work


def until_tracking(served: ServedDaemon) -> None:
    served.rig.enable()
    served.rig.request(Event.START)
    served.run(0.5)


def test_a_payload_without_a_lever_is_carried(served: ServedDaemon) -> None:
    until_tracking(served)
    result = served.contactctl("payload", "0.3", "--com", "0", "0", "0")
    assert (result.exit_code, result.stdout) == (0, "payload: 0.3 kg at (0.000 0.000 0.000) m\n")
    assert served.rig.mode is Mode.TRACKING


def test_a_request_that_breaks_is_answered_and_logged(
    served: ServedDaemon,
    client: Client,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    until_tracking(served)
    place = served.rig.tick.controller.motion.follower.place
    monkeypatch.setattr(Commands, "_status", breaks)
    reply = served.ask(client, "status")
    assert (reply.ok, reply.message) == (False, BROKEN)
    (entry,) = [r for r in caplog.records if "internal error" in r.message]
    assert entry.levelno == logging.ERROR
    assert "ZeroDivisionError: on purpose at test_internal_errors.py:" in entry.message
    assert "in breaks, answering uid" in entry.message
    assert '{"command":"status"}' in entry.message
    served.run(0.5)
    assert served.rig.mode is Mode.TRACKING
    assert served.rig.tick.controller.motion.follower.place.path is place.path


def test_many_errors_leave_few_lines_in_the_log(
    served: ServedDaemon,
    client: Client,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(Commands, "_status", breaks)
    for _ in range(200):
        served.ask(client, "status")
    assert 0 < sum("internal error" in r.message for r in caplog.records) < 60


@pytest.mark.parametrize("encodes", [False, True])
def test_an_error_of_decoding_or_encoding_is_answered(
    served: ServedDaemon, client: Client, encodes: bool
) -> None:
    control = served.service.control
    if encodes:
        encode, calls = control._receiver._encoder.encode, iter([breaks])

        class Encoder:
            def encode(self, reply: Any) -> bytes:
                return bytes(next(calls, encode)(reply))

        control._receiver._encoder = Encoder()  # type: ignore[assignment]
    else:

        class Decoder:
            decode = staticmethod(breaks)

        control.answers._decoder = Decoder()  # type: ignore[assignment]
    assert served.ask(client, "status").message == BROKEN


@pytest.mark.parametrize(
    ("before", "command", "of", "name", "after"),
    [
        # What a request had begun comes to rest...
        ("off", "enable", Controller, "request", Mode.OFF),
        ("holding", "start", Controller, "request", Mode.HOLDING),
        ("holding", "arm", Controller, "arm", Mode.HOLDING),
        ("faulted", "reset", Controller, "request", Mode.FAULTED),
        ("tracking", "payload", Tick, "carry", Mode.TRACKING),
        # ...also where it was done, and only its answer broke...
        ("holding", "start", Commands, "_start_motion", Mode.HOLDING),
        ("holding", "arm", Commands, "_granted", Mode.HOLDING),
        # ...and what should have made the arm stiller does so.
        ("tracking", "stop", Controller, "request", Mode.FAULTED),
        ("tracking", "pause", Commands, "_reply", Mode.FAULTED),
        ("tracking", "disarm", Commands, "_reply", Mode.FAULTED),
        ("tracking", "disable", Commands, "_reply", Mode.FAULTED),
        ("off", "stop", Commands, "_reply", Mode.OFF),
    ],
)
def test_a_request_that_breaks_half_way_begins_no_motion(
    served: ServedDaemon,
    client: Client,
    monkeypatch: pytest.MonkeyPatch,
    before: str,
    command: str,
    of: type,
    name: str,
    after: Mode,
) -> None:
    if before == "tracking":
        until_tracking(served)
    elif before != "off":
        served.rig.enable()
        served.run(0.5)
    if before == "faulted":
        served.rig.tick.controller.apply_event(Event.FAULT, "the test", served.rig.time_s)
        served.run(0.5)
    monkeypatch.setattr(of, name, breaking_after(getattr(of, name)))
    request = SetPayload(mass=0.2) if command == "payload" else bare(command)
    assert served.until(lambda: client.ask(request)).message == BROKEN
    monkeypatch.undo()
    served.run(1.0)
    machine = served.rig.tick.controller.machine
    assert (machine.mode, machine.armed) == (after, False)
    assert served.service.commands.permission.lease is None
    assert not machine.moving or before == "tracking"


@pytest.mark.parametrize("command", ["enable", "start", "go", "arm", "stop", "gain", "reset"])
@pytest.mark.parametrize("mode", list(Mode))
def test_no_remedy_arms_or_starts_the_arm(command: Any, mode: Mode) -> None:
    for was in Mode:
        checkpoint = Checkpoint(was, armed=False, place=None, lease=None)  # type: ignore[arg-type]
        for armed in (False, True):
            event = remedy(command, checkpoint, mode, armed=armed)
            assert event in (None, Event.STOP, Event.FAULT, Event.DISARM)
            if event is None:
                assert mode is was
                assert not armed
                assert command not in STILLING or mode not in ENERGISED


def test_an_error_of_a_tick_ends_it(served: ServedDaemon, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Controller, "step", breaks)
    with pytest.raises(ZeroDivisionError):
        served.tick()


def test_the_text_of_an_error_is_one_line_of_bounded_length() -> None:
    text = error_in_words(ValueError("a\nb" + 1000 * "x"))
    assert text.startswith("internal error: ValueError: a?bx")
    assert len(text) < 300
