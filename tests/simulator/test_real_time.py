"""The simulated arm on a clock of its own that runs, jumps and outruns it."""

import contextlib
import io
import json
import socket
from dataclasses import dataclass

import pytest

from simulator import server as server_module
from simulator.description import ArmDescription, SimulationSettings
from simulator.server import LONGEST_GAP_S, LONGEST_TURN_S, RealTimeArm, Server

START = 500.0


@dataclass
class FakeTime:
    now_s: float = START
    costs_s: float = 0.0  # of each look

    def monotonic(self) -> float:
        self.now_s += self.costs_s
        return self.now_s

    time = monotonic


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FakeTime:
    made = FakeTime()
    monkeypatch.setattr(server_module, "time", made)
    return made


@pytest.fixture
def reports() -> io.BytesIO:
    return io.BytesIO()


@pytest.fixture
def real_time(romeo: ArmDescription, clock: FakeTime, reports: io.BytesIO) -> RealTimeArm:
    return RealTimeArm(romeo, SimulationSettings(), lambda _: None, (), reports)


def lived(real_time: RealTimeArm, clock: FakeTime, turns: int, each_s: float) -> int:
    """So many turns that take so long each; the periods that the plant lived through."""
    periods = 0
    for _ in range(turns):
        clock.now_s += each_s
        before = real_time.arm.now
        real_time.live()
        # The clocks may go on without the plant; what it lives through is at the end.
        periods += round(min(real_time.arm.now - before, LONGEST_TURN_S) * 1000)
    return periods


def test_a_little_behind_it_catches_up_between_looks_at_the_bus(
    real_time: RealTimeArm, clock: FakeTime, reports: io.BytesIO
) -> None:
    lived(real_time, clock, 1, 0.05)
    assert real_time.arm.now == pytest.approx(LONGEST_TURN_S)
    assert lived(real_time, clock, 60, 0.001) >= 100
    assert real_time.arm.now == pytest.approx(0.11)
    assert not reports.getvalue()


def test_held_up_it_leaves_the_time_out(
    real_time: RealTimeArm, clock: FakeTime, reports: io.BytesIO
) -> None:
    lived(real_time, clock, 20, 0.001)
    lived(real_time, clock, 1, 5.0)
    assert real_time.arm.now < 0.03
    lived(real_time, clock, 20, 0.001)
    assert real_time.arm.now == pytest.approx(0.041, abs=0.002)
    (line,) = reports.getvalue().splitlines()
    assert json.loads(line)["text"] == "held up for 5.000 s, time left out"


def test_on_a_machine_that_is_too_slow_the_clocks_go_on_without_the_plant(
    real_time: RealTimeArm, clock: FakeTime, reports: io.BytesIO
) -> None:
    assert lived(real_time, clock, 200, 0.02) < 500
    assert 4.0 - LONGEST_GAP_S - 0.02 <= real_time.arm.now <= 4.0
    lines = [json.loads(line)["text"] for line in reports.getvalue().splitlines()]
    assert 3 <= len(lines) <= 5
    assert all("too slow by 0.1" in line for line in lines)


def test_a_sync_is_answered_by_a_plant_of_the_present(
    romeo: ArmDescription, clock: FakeTime
) -> None:
    """After a stall the daemon's interval is a long one, and so must the motion in it be."""
    with (
        contextlib.closing(Server(romeo, SimulationSettings(), port=0)) as server,
        socket.create_connection(("127.0.0.1", server.port)) as client,
    ):
        client.sendall(b"< open can0 >< rawmode >")
        while not server.arm.now:
            clock.now_s += 0.001
            server.turn(0.1)
        clock.now_s += 0.05
        before_s = server.arm.now
        client.sendall(b"< send 80 0 >")
        while server.arm.now - before_s <= 2 * LONGEST_TURN_S:
            server.turn(0.1)
        assert server.arm.now - before_s == pytest.approx(0.05, abs=0.002)


@pytest.mark.parametrize("behind_s", [0.5 * LONGEST_GAP_S, 2.0 * LONGEST_GAP_S, 1000.0])
def test_to_catch_up_ends(real_time: RealTimeArm, clock: FakeTime, behind_s: float) -> None:
    """However far behind, and on a machine whose plant is slower than the present."""
    clock.now_s += behind_s
    real_time.catch_up()
    clock.costs_s = 2.0 * LONGEST_TURN_S
    clock.now_s += behind_s
    real_time.catch_up()
    assert clock.monotonic() - START - 2.0 * behind_s < 2.0 * LONGEST_GAP_S
