"""Stream of targets through the control socket, in lockstep with a simulated arm."""

import asyncio
import math
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest

from bench.rigs.served_daemon import ServedDaemon
from contactd_client.aio import AsyncClient
from contactd_client.aio_stream import AsyncStream
from contactd_client.client import Client
from contactd_client.connection import Connection
from contactd_client.errors import ControlError
from contactd_client.packets import encode
from contactd_client.stream import Stream
from daemon.modes.table import Mode
from daemon.motion.covered_range import CoveredRange


def here(served: ServedDaemon) -> float:
    return float(served.rig.samples.link_position[0])


class Leader:
    """Client that sends a target a tick, by the daemon's time."""

    def __init__(self, served: ServedDaemon) -> None:
        self.served = served
        self.connection = Connection(served.path, 5.0)
        self.stream = Stream(self.connection, 5.0, clock=lambda: served.rig.time_s)

    def to(self, q: float, ticks: int = 1) -> None:
        if self.stream.reply is None:
            self.served.until(lambda: self.stream.to([q]))
        for _ in range(ticks):
            self.stream.to([q])  # waits for no answer
            self.served.tick()

    @property
    def phase(self) -> str:
        """Phase that the latest answer reports."""
        assert self.stream.state is not None
        return self.stream.state["phase"]

    def close(self) -> None:
        self.connection.close()


@pytest.fixture
def leader(on: ServedDaemon) -> Iterator[Leader]:
    with closing(Leader(on)) as leader:
        yield leader


def test_a_stream_beyond_what_the_thresholds_have_seen_is_answered_with_warnings(
    on: ServedDaemon, leader: Leader, caplog: pytest.LogCaptureFixture
) -> None:
    begun = here(on)
    at = np.array([begun])
    on.service.process.seen = CoveredRange(np.array([0.2]), at - 0.15, at + 0.15)
    for k in range(60):
        leader.to(begun + 0.15 * math.sin(0.01 * k))
    assert leader.stream.reply is not None
    assert leader.stream.reply.get("warnings", []) == []
    for k in range(100):
        leader.to(begun + 0.15 * math.sin(0.6) + 0.0025 * k)
    warnings = leader.stream.reply.get("warnings", [])
    fast, far = warnings
    assert fast.startswith("joint moves at up to 0.2")
    assert far.startswith("joint moves within [")
    logged = [r.getMessage() for r in caplog.records if "thresholds cover" in r.getMessage()]
    assert len(logged) == 2


def test_the_arm_follows_and_halts_at_the_end(on: ServedDaemon, leader: Leader) -> None:
    begun = here(on)
    leader.to(begun, 5)
    for k in range(200):
        leader.to(begun + 0.2 * math.sin(0.02 * k))
    assert leader.phase == "following"
    reference = float(on.rig.decision.reference[0])  # the link floats in a wide gap
    assert reference == pytest.approx(begun + 0.2 * math.sin(0.02 * 196), abs=0.01)
    state = on.service.loop.tick.last
    assert state is not None
    assert state.stream is not None
    assert 0.0 < state.stream.delay_s <= 0.06
    status = on.contactctl("status", "--json")
    assert '"phase":"following"' in status.stdout.replace(" ", "")
    on.until(lambda: leader.stream.__exit__(None, None, None))
    assert on.rig.mode is Mode.STOPPING
    assert on.rig.tick.controller.machine.cause.endswith("ended its stream")
    assert not on.rig.tick.controller.machine.paused


def test_a_client_that_is_gone_stops_the_arm_at_once(on: ServedDaemon, leader: Leader) -> None:
    leader.to(here(on), 20)
    leader.close()
    on.run(0.02)
    assert on.rig.mode in (Mode.STOPPING, Mode.HOLDING)
    assert "its client is gone" in on.rig.tick.controller.machine.cause
    assert on.rig.tick.controller.stream is None


@pytest.mark.parametrize(
    ("far", "reason"),
    [
        ([0.9], "joint stands at .* rad from the target"),
        ([0.9], "`contactctl go joint=0.900` leads there"),
        ([0.1, 0.2], "`q` has 2 numbers; this arm has 1 joints: joint"),
        ([], "`q` has 0 numbers"),
    ],
)
def test_a_first_target_that_is_refused(
    on: ServedDaemon, leader: Leader, far: list[float], reason: str
) -> None:
    with pytest.raises(ControlError, match=reason):
        on.until(lambda: leader.stream.to(far))
    assert on.rig.mode is Mode.HOLDING


def test_a_second_stream_and_its_targets_are_refused(on: ServedDaemon, leader: Leader) -> None:
    leader.to(here(on), 5)
    with closing(Leader(on)) as other:
        with pytest.raises(ControlError, match=r"the arm follows uid .* already"):
            other.to(here(on))
        with pytest.raises(ControlError, match="this connection sends no stream"):
            on.until(
                lambda: other.stream._exchange(
                    encode({"command": "target", "q": [0.0], "sent_s": 9.0, "number": 1})
                )
            )
    leader.to(here(on), 5)
    assert on.rig.mode is Mode.TRACKING


def test_a_stop_by_a_person_is_reported_to_its_sender(on: ServedDaemon, leader: Leader) -> None:
    leader.to(here(on), 5)
    assert on.contactctl("stop").exit_code == 0
    with pytest.raises(ControlError, match="no longer follows this connection: stop by uid"):
        leader.to(here(on), 5)


def test_a_touch_is_reported_to_the_sender_and_it_rejoins_when_asked(
    on: ServedDaemon, leader: Leader
) -> None:
    begun = here(on)
    leader.to(begun, 30)
    assert on.rig.permit() == []
    on.rig.arm.external_torque[0] = 6.0
    seen = set()
    for _ in range(100):
        leader.to(begun)
        assert leader.stream.state is not None
        seen.add(leader.stream.state.get("contact", ""))
    assert any(text.startswith("contact of ") for text in seen)
    assert on.rig.mode is Mode.ADMITTANCE
    on.rig.arm.external_torque[0] = 0.0
    leader.to(begun, 260)
    assert (on.rig.mode, leader.phase) == (Mode.TRACKING, "waiting")
    left = here(on)
    assert abs(left - begun) > 0.5
    with pytest.raises(ControlError, match=r"`stream.reach` allows 0\.5"):
        on.until(lambda: leader.stream.rejoin([begun]))
    begun = left - math.copysign(0.3, left - begun)
    leader.to(begun, 10)
    on.until(lambda: leader.stream.rejoin([begun]))
    leader.to(begun, 300)
    assert leader.phase == "following"
    assert here(on) == pytest.approx(begun, abs=0.02)


def test_a_flood_of_targets_does_not_delay_a_stop(on: ServedDaemon, leader: Leader) -> None:
    leader.to(here(on), 5)
    target = encode({"command": "target", "q": [0.0], "sent_s": 1.0, "number": 9})
    on.until(lambda: [leader.connection.send(target) for _ in range(100)])
    with Client(on.path) as client:
        before = on.rig.tick.number
        assert on.until(lambda: client.ask({"command": "stop"}))["ok"]
    assert on.rig.mode in (Mode.STOPPING, Mode.HOLDING)  # where the thread came late
    assert on.rig.tick.number - before < 50


def test_asyncio_streams_as_well(on: ServedDaemon) -> None:
    begun, phases = here(on), []

    async def lead() -> None:
        async with await AsyncClient.open(on.path) as client:
            stream = AsyncStream(client._connection, 5.0, clock=lambda: on.rig.time_s)
            async with stream as arm:
                for _ in range(100):
                    await arm.to([begun])
                    assert arm.state is not None
                    phases.append(arm.state["phase"])
                    await asyncio.sleep(0.001)
                await arm.rejoin([begun])
                assert on.rig.mode is Mode.TRACKING
            assert on.rig.mode in (Mode.STOPPING, Mode.HOLDING)

    on.until(lambda: asyncio.run(lead()))
    assert phases[-1] == "following"


def test_a_refused_asyncio_stream_says_why(on: ServedDaemon) -> None:
    async def lead() -> None:
        async with await AsyncClient.open(on.path) as client, client.follow() as arm:
            await arm.to([0.9])

    with pytest.raises(ControlError, match=r"`stream.reach` allows 0\.5"):
        on.until(lambda: asyncio.run(lead()))
    assert on.rig.mode is Mode.HOLDING


def test_the_end_of_a_lease_does_not_end_the_stream(on: ServedDaemon, leader: Leader) -> None:
    begun = here(on)
    leader.to(begun, 30)
    with Client(on.path) as client:
        assert on.until(lambda: client.ask({"command": "arm", "lease_s": 0.3}))["ok"]
        assert on.rig.tick.controller.machine.armed
        assert on.service.control.spare
        leader.to(begun, 40)
        assert not on.service.control.spare, "it may make room for another client again"
    assert not on.rig.tick.controller.machine.armed
    assert on.rig.mode is Mode.TRACKING
    assert leader.phase == "following"


def test_a_collision_halts_a_stream_that_is_not_armed(on: ServedDaemon, leader: Leader) -> None:
    begun = here(on)
    leader.to(begun, 30)
    on.rig.arm.external_torque[0] = 9.0
    leader.to(begun, 5)
    on.rig.arm.external_torque[0] = 0.0
    leader.to(begun, 100)
    assert on.rig.mode in (Mode.HOLDING, Mode.STOPPING, Mode.RELEASING)
    assert leader.phase == "paused"
