"""The simulated arm on a clock of its own that runs, jumps and outruns it."""

import io
import json
from dataclasses import dataclass

import pytest

from simulator import server as server_module
from simulator.description import ArmDescription, SimulationSettings
from simulator.server import LONGEST_GAP_S, LONGEST_TURN_S, RealTimeArm

START = 500.0


@dataclass
class FakeTime:
    now_s: float = START

    def monotonic(self) -> float:
        return self.now_s


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
