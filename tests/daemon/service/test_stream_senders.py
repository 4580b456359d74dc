"""Senders of streams: their clocks, who owns a stream, and what its sender is answered."""

import math
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial

import numpy as np
import pytest

from bench.rigs.served_daemon import ServedDaemon
from contactd_client.client import Client
from contactd_client.connection import Connection
from contactd_client.errors import ControlError
from contactd_client.messages import Request
from contactd_client.stream import Stream
from daemon.modes.table import Mode
from daemon.motion.covered_range import CoveredRange


def here(served: ServedDaemon) -> float:
    return float(served.rig.samples.link_position[0])


@contextmanager
def stream_of(
    served: ServedDaemon, clock: Callable[[float], float] = lambda s: s
) -> Iterator[Stream]:
    """Stream of a new connection, with the daemon's time as `clock` makes it."""
    with closing(Connection(served.path, 5.0)) as connection:
        yield Stream(connection, 5.0, clock=lambda: clock(served.rig.time_s))


def send(served: ServedDaemon, stream: Stream, q: float, ticks: int = 1) -> None:
    for _ in range(ticks):
        if stream.reply is None:
            served.until(lambda: stream.to([q]))
        else:
            stream.to([q])
        served.tick()


@pytest.mark.parametrize("unit", [1e6, 1e9], ids=["us", "ns"])
def test_a_clock_in_another_unit_is_named(on: ServedDaemon, unit: float) -> None:
    with stream_of(on) as stream:
        send(on, stream, 0.4, 400)
    on.run(0.5)
    begun = here(on)
    with stream_of(on, lambda s: unit * (1.8e9 + s)) as stream:
        with pytest.raises(ControlError, match=r"jumped forwards \d+ times: `sent_s` is in sec"):
            send(on, stream, begun, 300)
        assert abs(here(on) - begun) < 0.05


@pytest.mark.parametrize("time_s", [1e14, 1e17, 1e308, -1e308])
def test_a_huge_time_that_repeats_is_no_fault(on: ServedDaemon, time_s: float) -> None:
    with stream_of(on, lambda _: time_s) as stream:
        send(on, stream, here(on), 15)
        assert np.isfinite(on.rig.decision.reference).all()
        assert on.rig.mode is Mode.TRACKING


@pytest.mark.parametrize("step_s", [1.0, 1.8e9])
def test_a_clock_that_is_set_forwards_is_followed_on(on: ServedDaemon, step_s: float) -> None:
    begun, zero_s = here(on), on.rig.time_s

    def leader(s: float) -> float:
        return begun + 0.2 * math.sin(1.5 * (s - zero_s))

    with stream_of(on, lambda s: s + (step_s if s > zero_s + 2.0 else 0.0)) as stream:
        for k in range(600):
            if k % 5 == 0 or stream.reply is None:
                send(on, stream, leader(on.rig.time_s))
            else:
                on.tick()
            if k > 300:
                assert stream.state is not None
                behind = leader(on.rig.time_s - stream.state["delay_s"])
                assert float(on.rig.decision.reference[0]) == pytest.approx(behind, abs=0.05)


def test_a_stream_with_a_fast_clock_is_followed(on: ServedDaemon) -> None:
    begun, zero_s = here(on), on.rig.time_s
    with stream_of(on, lambda s: zero_s + 1.5 * (s - zero_s)) as stream:
        for k in range(500):
            q = begun + 0.2 * math.sin(0.01 * k)
            send(on, stream, q)
            if k > 100:
                assert float(on.rig.decision.reference[0]) == pytest.approx(q, abs=0.1)


def test_a_client_follows_twice_on_one_connection(on: ServedDaemon) -> None:
    begun = here(on)
    with closing(Connection(on.path, 5.0)) as connection:
        for _ in range(2):
            stream = Stream(connection, 5.0, clock=lambda: on.rig.time_s)
            send(on, stream, begun, 50)
            assert on.rig.mode is Mode.TRACKING
            on.until(stream.end)
            on.run(0.1)


def test_a_start_by_another_client_leaves_the_stream(on: ServedDaemon) -> None:
    begun = here(on)
    with Client(on.path) as other, stream_of(on) as stream:
        send(on, stream, begun, 20)
        assert on.until(lambda: other.ask({"command": "pause"}))["ok"]
        send(on, stream, begun, 30)
        on.until(lambda: other.ask({"command": "start", "attended": True}))
        for k in range(30):
            send(on, stream, begun + 0.01 * k)
        assert on.rig.mode is Mode.TRACKING
        stream._connection.close()
        on.run(0.03)
        assert on.rig.tick.controller.stream is None


def test_a_pause_by_another_client_is_undone_by_no_sender(on: ServedDaemon) -> None:
    """Neither by a rejoin nor, as LeRobot's plug-in begins anew, after silence."""
    begun = here(on)
    with Client(on.path) as other, stream_of(on) as stream:
        send(on, stream, begun, 20)
        on.until(lambda: other.ask({"command": "pause"}))
        on.run(0.1)
        with pytest.raises(ControlError, match=r"pause by uid .*; `contactctl start` goes on"):
            on.until(lambda: stream.rejoin([begun + 0.3]))
        on.run(1.0)
        assert on.rig.mode is Mode.HOLDING
        assert "pause by uid" in on.rig.tick.controller.machine.cause
        assert "fell silent" not in on.rig.tick.controller.machine.cause


@pytest.mark.parametrize("ticks", [4, 6])
def test_a_slow_sender_is_answered_with_a_short_touch(on: ServedDaemon, ticks: int) -> None:
    """At 20 Hz; the touch begins and ends between two targets."""
    begun, heard = here(on), set()
    with stream_of(on) as stream:
        send(on, stream, begun)
        for k in range(300):
            if k % 5 == 0:
                stream.to([begun])
            if k == 100:
                assert on.rig.permit() == []
            on.rig.arm.external_torque[0] = 6.0 if 0 <= k - 201 < ticks else 0.0
            on.tick()
            assert stream.state is not None
            if contact := stream.state.get("contact"):
                heard.add((k - 201) // 100)
                assert "joint" in contact
        assert heard == {0}, "within a second, and not for ever"


def test_a_stream_of_follow_requests_is_warned_too(on: ServedDaemon) -> None:
    begun, warnings = here(on), []
    at = np.array([begun])
    on.service.process.seen = CoveredRange(np.array([0.05]), at - 0.01, at + 0.01)
    with Client(on.path) as client:
        for k in range(40):
            q = begun + 0.2 * math.sin(0.1 * k)
            now_s = on.rig.time_s
            request: Request = {"command": "follow", "q": [q], "sent_s": now_s, "number": k}
            warnings += on.until(partial(client.ask, request)).get("warnings", [])
            on.run(0.03)
    assert warnings
