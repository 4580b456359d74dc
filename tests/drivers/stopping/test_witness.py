"""Detection of a standstill: two sensors that agree, and none that repeats its reading."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import pytest

from drivers.stopping.witness import FROZEN_READINGS, MOVES, STANDS, Witness

T = 0.01
Course = Callable[[int], float]


@dataclass
class Sensors:
    """Readings in tick k of a motor that ran at 0.5 rad/s and was commanded to until tick 0,
    and stops from then on within 0.1 s, unless it `runs_on`."""

    runs_on: float = 0.0  # [rad/s]
    velocity: Course | None = None
    link: Course | None = None
    motor: Course | None = None  # math.nan: it has none
    commanded: float = 0.5
    noise: bool = True
    position: float = field(default=0.0, init=False)

    def speed(self, k: int) -> float:
        return 0.5 if k < 0 else max(0.5 - 0.05 * k, self.runs_on)

    def samples(self, ticks: range) -> Iterator[tuple[int, tuple[float, float, float, float]]]:
        for k in ticks:
            v = self.speed(k)
            self.position += v * T
            bits = 1e-6 * (k % 7) if self.noise else 0.0
            shown = [
                course(k) if course else true
                for course, true in (
                    (self.velocity, v + bits),
                    (self.link, self.position),
                    (self.motor, self.position),
                )
            ]
            yield k, (shown[0], 0.1 + bits, shown[1], shown[2])


def first_stands(sensors: Sensors, ticks: int = 200) -> int | None:
    """Tick in which they agree that it stands."""
    witness = Witness()
    for k, (velocity, current, link, motor) in sensors.samples(range(-50, ticks)):
        now = k * T
        witness.take(now, velocity, current, link, motor)
        if k < 0:
            witness.command(now, sensors.commanded)
        elif witness.stands(now, velocity) and not witness.repeats:
            return k
    return None


def none(k: int) -> float:
    return math.nan


def dead(k: int) -> float:
    return 0.0


def frozen(k: int) -> float:
    return 0.123


@pytest.mark.parametrize("noise", [True, False])
@pytest.mark.parametrize("motor", [None, none])
def test_a_drive_stands_when_its_velocity_came_down_and_its_positions_rest(noise, motor) -> None:
    assert first_stands(Sensors(noise=noise, motor=motor)) == 10


@pytest.mark.parametrize(
    ("sensors", "about"),
    [
        (Sensors(0.5), "it says so, and runs on"),
        (Sensors(0.5, link=frozen), "its link encoder frozen"),
        (Sensors(0.5, link=frozen, motor=none), "and it has no other"),
        (Sensors(0.09, link=frozen, motor=none), "slowly"),
        (Sensors(0.03, motor=none), "creeping"),
        (Sensors(0.5, velocity=dead), "its velocity is none"),
        (Sensors(0.12, velocity=lambda k: max(0.5 - 0.02 * k, 0.0), motor=none), "its link creeps"),
        (Sensors(0.06, velocity=lambda k: max(0.5 - 0.02 * k, 0.0)), "more slowly"),
        (Sensors(0.5, velocity=dead, link=frozen), "and its link encoder frozen"),
        (Sensors(0.5, velocity=dead, link=frozen, motor=none), "and it has no other"),
        (Sensors(0.03, velocity=dead, link=frozen), "creeping"),
        (Sensors(0.5, velocity=lambda k: 0.3, link=frozen, motor=frozen), "all of them"),
        (Sensors(0.5, velocity=dead, link=frozen, motor=frozen, noise=False), "since it stood"),
        (Sensors(0.5, velocity=lambda k: 0.5 if k < 2 else 0.0), "its velocity lost"),
        (Sensors(0.5, velocity=lambda k: 0.5 if k < 2 else 0.0, motor=none), "and no motor's"),
    ],
)
def test_sensors_that_disagree_or_repeat_prove_no_standstill(sensors: Sensors, about: str) -> None:
    assert first_stands(sensors) is None, about


def test_a_standstill_is_proved_beside_one_dead_sensor() -> None:
    assert first_stands(Sensors(link=frozen)) == 10
    by_positions = first_stands(Sensors(velocity=dead))
    assert by_positions is not None
    assert 20 < by_positions < 9 + 21, "0.2 s of rest"
    assert first_stands(Sensors(velocity=lambda k: Sensors().speed(k) + 0.05)) is not None, "a bias"


def test_a_drive_held_still_stands_when_its_position_changed() -> None:
    held = Sensors(velocity=dead, motor=none)
    held.link = lambda k: 1e-5 * (k % 2)  # type: ignore[method-assign]
    assert first_stands(held) is not None


@pytest.mark.parametrize(
    ("commanded", "way", "moved", "shown", "stands"),
    [
        (0.05, 0.015, True, 0.0, True),
        (-0.09, 0.018, True, 0.0, True),
        (0.05, 0.025, True, 0.0, False),
        (0.05, 0.015, False, 0.0, False),  # its encoder never showed anything
        (0.05, 0.015, True, 0.15, False),  # its velocity shows that it moves, and then a bias
        (0.2, 0.015, True, 0.0, False),  # a motor does not stick that fast
    ],
)
def test_a_motor_may_stick_before_its_slow_setpoints_end(
    commanded, way, moved, shown, stands
) -> None:
    witness = Witness()
    sticks, over = 50, 50 + round(way / abs(commanded) / T)
    for k in range(over + 50):
        speed = commanded if k < sticks else shown if k < over else shown / 3.0
        link = commanded * T * min(k, sticks) if moved else 0.3
        witness.take(k * T, speed + 1e-4 * (k % 5), 0.1, link)
        witness.command(k * T, commanded if k < over else 0.0)
    assert witness.stands(k * T, shown / 3.0) is stands


@pytest.mark.parametrize(
    ("seen", "burst", "rest", "velocity", "every"),
    [
        (0, 18, 0, 0.09, 1),  # its encoder was dead all along
        (1, 18, 0, 0.09, 1),  # and flickered once
        (50, 18, 60, 0.09, 1),  # it died in a pause; in a short one it looks as one that sticks
        (50, 18, 0, 0.0, 1),  # nor was a velocity ever seen
        (50, 240, 0, 0.09, 60),  # ticks that are late by more than such a pause
    ],
)
def test_a_sensor_that_dies_in_slow_setpoints_proves_nothing(
    seen, burst, rest, velocity, every
) -> None:
    """It runs on: neither sensor shows that, and its drive ignores a setpoint of 0."""
    witness, k = Witness(), 0
    for k in [*range(50), *range(50, 100 + rest + burst, every)]:
        moves = 50 - seen <= k < 50 or 50 + rest <= k < 50 + rest + burst
        link = 0.3 + 9e-4 * max(min(k, 50) - 50 + seen, 0)
        shown = velocity if 50 - seen <= k < 50 else 0.0
        witness.take(k * T, shown, 0.1 + 1e-3 * (k % 5), link)
        witness.command(k * T, 0.09 if moves else 0.0)
    assert not witness.stands(k * T, 0.0)


@pytest.mark.parametrize(("left", "stands"), [(18, True), (5, True), (0, False)])
def test_a_motor_may_stick_in_a_motion_too_slow_for_its_velocity(left: int, stands: bool) -> None:
    """It coasted before, and went on by half a milliradian a tick for so many ticks, then stuck."""
    witness, link, k = Witness(), 0.0, 0
    for k in range(200):
        coasts, creeps = k < 80, 110 <= k < 110 + left
        link += 5e-4 * coasts - 5e-4 * creeps
        witness.take(k * T, 0.05 * coasts + 1e-4 * (k % 5), 0.1, link)
        witness.command(k * T, 0.05 * (k < 50) - 0.05 * (110 <= k < 110 + left + 30))
    assert witness.stands(k * T, 0.0) is stands


@pytest.mark.parametrize(("pause", "stands"), [(27, True), (60, False)])
def test_a_motor_may_stick_after_a_short_pause_of_its_setpoints(pause: int, stands: bool) -> None:
    witness, k = Witness(), 0
    for k in range(120 + pause):
        speed = 0.05 if k < 50 else 0.0
        witness.take(k * T, speed + 1e-4 * (k % 5), 0.1, 0.05 * T * min(k, 50))
        witness.command(k * T, speed - (0.05 if 50 + pause <= k < 75 + pause else 0.0))
    assert witness.stands(k * T, 0.0) is stands


@pytest.mark.parametrize("history_s", [0.0, 0.1, 0.5])
def test_a_drive_that_stood_all_along_needs_no_more_than_a_rest(history_s: float) -> None:
    witness, k = Witness(), 0
    while True:
        witness.take(k * T, 0.0, 0.0, 0.3)
        if k * T >= history_s and witness.stands(k * T, 0.0):
            break
        k += 1
    assert k * T == pytest.approx(max(0.2, history_s))


@pytest.mark.parametrize(("commanded", "velocity"), [(STANDS, 0.0), (0.0, MOVES), (-0.5, 0.0)])
def test_readings_that_repeat_in_motion_are_reported(commanded: float, velocity: float) -> None:
    witness, found = Witness(), []
    for k in range(30):
        witness.command(k * T, commanded)
        witness.take(k * T, velocity, 0.1, 0.2, 0.3)
        found.append(witness.repeats)
    assert found.index(True) == FROZEN_READINGS
    assert all(found[found.index(True) :])
    witness.take(0.3, velocity, 0.1, 0.2, 0.3001)
    assert not witness.repeats, "any bit of any of them"


def test_a_drive_at_rest_has_as_many_readings_to_begin_to_move() -> None:
    witness = Witness()
    for k in range(50):
        witness.take(k * T, 0.0, 0.1, 0.2, 0.3)
    for k in range(50, 50 + FROZEN_READINGS):
        assert not witness.repeats
        witness.command(k * T, 0.5)
        witness.take(k * T + 0.5 * T, 0.0, 0.1, 0.2, 0.3)
    assert witness.repeats


def test_readings_of_a_drive_that_stands_may_repeat() -> None:
    witness = Witness()
    for k in range(30):
        witness.command(k * T, 0.9 * STANDS)
        witness.take(k * T, 0.9 * MOVES, 0.1, 0.2, 0.3)
        assert not witness.repeats


def test_missing_samples_change_nothing() -> None:
    witness = Witness()
    witness.take(0.0, 0.0, 0.1, 0.2, 0.3)
    for k in range(1, 30):
        witness.command(k * T, 0.5)
        witness.take(k * T, math.nan, math.nan, math.nan, math.nan)
    assert witness.repeats
    assert not witness.stands(0.3, math.nan)


@pytest.mark.parametrize("count", [0.0049, 0.9 * STANDS])  # [rad/s]
def test_a_coarse_velocity_of_a_motor_that_stood_for_long_does_not_fade(count: float) -> None:
    sensors = Sensors(velocity=lambda k: Sensors().speed(k) if k < 10 else count * (k % 3 == 0))
    witness = Witness()
    for k, samples in sensors.samples(range(-50, 6000)):
        witness.take(k * T, *samples)
        if k < 0:
            witness.command(k * T, sensors.commanded)
        elif k > 50:
            assert witness.stands(k * T, samples[0]), k


@pytest.mark.parametrize("begin", [0.09, 0.3])  # [rad/s]
@pytest.mark.parametrize("stood_s", [0.0, 10.0])
def test_a_velocity_that_fades_beside_positions_that_froze_is_no_stand(
    begin: float, stood_s: float
) -> None:
    """After a rest, too, in which the velocity read a count now and then."""
    witness, rest = Witness(sudden=20.0), round(stood_s / T)
    for k in range(-rest - 50, 200):
        moving = -50 <= k < 0
        faded = begin * math.exp(-0.1 * max(k, 0)) if k >= -50 else 0.005 * (k % 3 == 0)
        position = begin * T * max(min(k, 0), -50)
        witness.take(k * T, faded, 0.01 * (k % 7), position, position)
        if moving:
            witness.command(k * T, begin)
        assert k < 0 or not witness.stands(k * T, faded), k
