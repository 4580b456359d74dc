"""What the arm does in each mode, from made-up observations of a single ideal joint."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from daemon.admittance import AdmittanceLaw
from daemon.controller import Controller, Decision, Observed, Tuning
from daemon.limits import Limits
from daemon.modes import Event, Mode
from daemon.supervisor import Condition, Finding
from daemon.trajectory import Follower, JointPath
from drivers.cia402 import PowerTarget

T = 0.01
AMPLITUDE, FREQUENCY = 0.3, 0.2
TUNING = Tuning(("a", "b"), ("hold", "brake"), 8.0, 2.0, 3.0, 3.0)
LIMITS = Limits(np.full(2, -1.0), np.full(2, 1.0), np.full(2, 1.0), np.full(2, 4.0), T)
LAW = AdmittanceLaw(np.array([0.5, 0.5]), 0.05, np.full(2, 0.5), 5.0, 0.4)


@dataclass
class Bench:
    """A controller, and joints that do exactly what they are told."""

    controller: Controller
    q: np.ndarray = field(default_factory=lambda: np.array([0.1, -0.2]))
    tick: int = 0
    decisions: list[Decision] = field(default_factory=list)

    @property
    def time_s(self) -> float:
        return self.tick * T

    @property
    def mode(self) -> Mode:
        return self.controller.machine.mode

    @property
    def armed(self) -> bool:
        return self.controller.machine.armed

    def step(self, **seen: object) -> Decision:
        before = self.decisions[-1].velocity if self.decisions else np.zeros(2)
        calm = Observed(self.q.copy(), before, np.zeros(2), "", "", True, (), ())
        decision = self.controller.step(self.time_s, T, replace(calm, **seen))
        self.q = self.q + decision.velocity * T
        self.tick += 1
        self.decisions.append(decision)
        return decision

    def run(self, seconds: float, **seen: object) -> None:
        for _ in range(round(seconds / T)):
            self.step(**seen)

    def request(self, event: Event) -> list[str]:
        return self.controller.request(event, "me", self.time_s)

    def push(self, torque: float) -> dict[str, object]:
        return {"thresholded": np.array([torque, 0.0])}

    def touch(self, torque: float = 0.4) -> None:
        self.step(touched="a feels it", **self.push(torque))


def controller(law: AdmittanceLaw = LAW) -> Controller:
    path = JointPath(np.array([AMPLITUDE, 0.0]), np.array([2 * np.pi * FREQUENCY, 0.0]))
    return Controller(TUNING, LIMITS, law, Follower(path, 1.0))


@pytest.fixture
def holding() -> Bench:
    bench = Bench(controller())
    bench.step(energised=False)
    assert bench.request(Event.ENABLE) == []
    bench.step()
    assert bench.mode is Mode.HOLDING
    return bench


@pytest.fixture
def tracking(holding: Bench) -> Iterator[Bench]:
    assert holding.request(Event.START) == []
    holding.run(1.5)
    assert holding.mode is Mode.TRACKING
    yield holding
    velocities = np.array([decision.velocity for decision in holding.decisions])
    # Whatever happened: the setpoint never jumped, except to the zero of a quick stop.
    if holding.mode is not Mode.FAULTED:
        assert (np.abs(np.diff(velocities, axis=0)) <= LIMITS.acceleration * T + 1e-12).all()


def test_armed_a_contact_leads_to_admittance(tracking: Bench) -> None:
    assert tracking.controller.arm("me") == []
    tracking.touch()
    assert tracking.mode is Mode.ADMITTANCE
    assert tracking.controller.machine.cause == "a feels it"
    tracking.run(1.0, **tracking.push(0.4))
    assert tracking.decisions[-1].velocity[0] == pytest.approx(0.2, rel=1e-3)  # K_a r_bar


def test_unarmed_a_contact_is_only_reported(tracking: Bench) -> None:
    tracking.touch()
    assert tracking.mode is Mode.TRACKING


def test_unarmed_a_collision_stops(tracking: Bench) -> None:
    tracking.step(touched="a feels it", hit="a was hit", **tracking.push(3.0))
    assert tracking.mode is Mode.STOPPING
    assert tracking.controller.machine.cause == "a was hit"
    tracking.run(0.5)
    assert tracking.mode is Mode.HOLDING


def test_armed_a_collision_is_a_contact(tracking: Bench) -> None:
    tracking.controller.arm("me")
    tracking.step(touched="a feels it", hit="a was hit", **tracking.push(3.0))
    assert tracking.mode is Mode.ADMITTANCE


def test_after_two_quiet_seconds_it_goes_on_from_where_it_was_left(tracking: Bench) -> None:
    tracking.controller.arm("me")
    tracking.touch()
    tracking.run(0.5, **tracking.push(0.6))
    last = tracking.time_s - T
    while tracking.mode is Mode.ADMITTANCE:
        tracking.step()
    assert tracking.mode is Mode.TRACKING
    assert 2.0 - 1e-9 <= tracking.time_s - T - last <= 2.01 + 1e-9
    np.testing.assert_allclose(tracking.decisions[-1].reference, tracking.q, atol=1e-3)
    assert tracking.armed
    tracking.run(1.0)
    assert abs(tracking.decisions[-1].velocity[0]) > 0.05


def test_the_quiet_time_begins_with_the_contact_however_faint(tracking: Bench) -> None:
    tracking.controller.arm("me")
    tracking.touch(0.0)
    tracking.run(1.9)
    assert tracking.mode is Mode.ADMITTANCE
    tracking.run(0.2)
    assert tracking.mode is Mode.TRACKING


def test_touched_while_holding_it_holds_where_it_was_left(holding: Bench) -> None:
    holding.controller.arm("me")
    holding.touch()
    assert holding.mode is Mode.ADMITTANCE
    holding.run(0.3, **holding.push(0.6))
    holding.run(2.1)
    assert holding.mode is Mode.HOLDING
    left = holding.q.copy()
    holding.run(0.5)
    np.testing.assert_allclose(holding.q, left, atol=1e-3)


@pytest.mark.parametrize(
    ("torque", "words"), [(2.0, "further than 0.4 rad"), (0.01, "more than 5 s")]
)
def test_a_bound_ends_in_holding_and_disarmed(tracking: Bench, torque: float, words: str) -> None:
    tracking.controller.arm("me")
    tracking.touch(torque)
    for _ in range(600):
        tracking.step(**tracking.push(torque))
        if tracking.mode is not Mode.ADMITTANCE:
            break
    assert tracking.mode is Mode.STOPPING
    assert words in tracking.controller.machine.cause
    tracking.run(0.5)
    assert tracking.mode is Mode.HOLDING
    assert not tracking.armed
    assert not tracking.controller.machine.moving


def test_a_path_that_no_longer_fits_ends_in_holding_with_the_reason() -> None:
    bench = Bench(controller(replace(LAW, max_excursion=3.0)))
    bench.step()
    for event in (Event.ENABLE, Event.START):
        bench.request(event)
        bench.run(0.2)
    bench.controller.arm("me")
    bench.touch(1.0)
    bench.run(2.5, **bench.push(1.0))
    assert bench.q[0] > 0.9
    bench.run(2.1)
    assert bench.mode is Mode.HOLDING
    assert "the path of a would leave its limits [-1, 1]" in bench.controller.machine.cause
    assert not bench.controller.machine.moving


def test_disarmed_while_guided_nothing_goes_on_by_itself_later(tracking: Bench) -> None:
    tracking.controller.arm("me")
    tracking.touch()
    tracking.request(Event.DISARM)
    assert tracking.mode is Mode.STOPPING
    tracking.run(0.5)
    tracking.controller.arm("me")
    tracking.touch()
    tracking.run(2.5)
    assert tracking.mode is Mode.HOLDING


def test_arming_is_refused_with_every_reason(holding: Bench) -> None:
    assert Bench(controller()).controller.arm("me") == ["no samples of the drives yet"]
    holding.request(Event.STOP)
    holding.controller.step(
        holding.time_s,
        T,
        Observed(holding.q, np.ones(2), np.zeros(2), "", "", True, (), ("b is touched", "late")),
    )
    reasons = holding.controller.arm("me")
    assert reasons == ["the arm is still stopping", "b is touched", "late"]
    assert not holding.armed


def test_start_and_enable_are_refused_with_the_reason(holding: Bench) -> None:
    holding.step(q=np.array([0.8, 0.0]))
    assert "from 0.800 rad the path of a would leave" in holding.request(Event.START)[0]
    assert holding.mode is Mode.HOLDING
    off = Bench(controller(), q=np.array([0.0, 1.2]))
    off.step()
    assert off.request(Event.ENABLE)[0].startswith("b stands at 1.200 rad, outside its limits")
    assert off.request(Event.START) == [
        "cannot start: the drives are off (`contactctl enable` first)"
    ]
    assert off.mode is Mode.OFF


def test_drives_that_do_not_follow_time_out() -> None:
    bench = Bench(controller())
    bench.step(energised=False)
    bench.request(Event.ENABLE)
    bench.run(2.9, energised=False)
    assert bench.mode is Mode.ENABLING
    bench.run(0.2, energised=False)
    assert bench.mode is Mode.OFF


def test_an_arm_that_does_not_stop_is_a_fault(tracking: Bench) -> None:
    tracking.request(Event.STOP)
    tracking.run(3.1, motor_velocity=np.array([0.0, 0.1]))
    assert tracking.mode is Mode.FAULTED


def test_a_fault_stops_all_drives_until_reset(tracking: Bench) -> None:
    fault = (Finding(Condition.DRIVE_FAULT, "b"),)
    decision = tracking.step(findings=fault)
    assert tracking.mode is Mode.FAULTED
    assert decision.power == (PowerTarget.QUICK_STOP,) * 2
    assert not decision.velocity.any()
    tracking.request(Event.RESET)
    assert tracking.step(findings=fault).reset  # patience: the drive may still be in fault
    assert tracking.mode is Mode.OFF
    tracking.run(0.6, findings=fault)
    assert tracking.mode is Mode.FAULTED
    tracking.step()
    assert tracking.mode is Mode.FAULTED


def test_power_in_each_mode(holding: Bench) -> None:
    assert holding.step().power == (PowerTarget.ON,) * 2
    holding.request(Event.DISABLE)
    assert holding.step().power == (PowerTarget.QUICK_STOP, PowerTarget.OFF)  # hold, brake
