"""An arm without a bus: plant, servo and sensors stepped as `simulator.arm` does, SYNC by SYNC.

    recording = record(subject, scenario)

Setpoints pass through the counts of the drives and act from the next SYNC on, interpolated over the
period; samples pass through the drives' counts and the codec's conversion. So the daemon would see
the same samples on the bus, count for count. The loop on link position is the controller's, around
sinusoids that may stand still for a while.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from common.arrays import Matrix, Vector
from daemon.config.load import Robot
from drivers.canopen.codec import MEASURED, SetpointEncoder, link_side
from programs.simulate.simulated_robot import describe, read_simulation
from simulator.description import SimulationSettings
from simulator.mismatch import true_gears, true_parameters
from simulator.plant import Plant
from simulator.profile import PROFILE
from simulator.sensors import Sensors
from simulator.servo import SERVO_PERIOD_S, Servo
from simulator.servo_periods import ServoPeriods

CHUNK_S: Final = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """A robot as its configuration believes it to be, and the arm that is really there."""

    robot: Robot
    settings: SimulationSettings
    displacement_m: float = 0.0  # of every centre of mass, each in a direction of its own
    drift: float = 0.0  # friction of every joint swings by this share of itself ...
    drift_period_s: float = 240.0  # ... once in this time, each in a phase of its own
    friction: float = 1.0  # that of every joint, over its own
    interpolates: bool = True  # drives reach setpoints over a period, not at once


@dataclass(frozen=True, slots=True)
class Course:
    """Reference of the arm, a row for each tick: q [rad] and velocity [rad/s], (ticks, n)."""

    q: Matrix
    velocity: Matrix

    def course(self, ticks: int, period_s: float) -> "Course":
        """The first rows of it."""
        del period_s
        return Course(self.q[:ticks], self.velocity[:ticks])


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """q_d = home + amplitude sin(omega s + phase), per joint (n,); s is the time spent moving."""

    home: Vector
    amplitude: Vector
    omega: Vector
    phase: Vector
    go_s: float = np.inf  # moves for so long, ramps included ...
    rest_s: float = 0.0  # ... then stands for so long, and again
    ramp_s: float = 2.0

    def rate(self, t: float) -> float:
        """ds / dt at time t [s]: 0 at rest, 1 in full motion."""
        t %= self.go_s + self.rest_s
        return float(np.clip(min(t, self.go_s - t) / self.ramp_s, 0.0, 1.0))

    def at(self, s: float, rate: float) -> tuple[Vector, Vector]:
        """q_d and its velocity, each (n,)."""
        angle = self.omega * s + self.phase
        return (
            self.home + self.amplitude * np.sin(angle),
            self.amplitude * (rate * self.omega * np.cos(angle)),
        )

    def course(self, ticks: int, period_s: float) -> Course:
        """It in so many ticks; the first reference is that of one period after its beginning."""
        s, rows = 0.0, np.empty((2, ticks, len(self.home)))
        for tick in range(ticks):
            rate = self.rate(tick * period_s)
            s += rate * period_s
            rows[:, tick] = self.at(s, rate)
        return Course(*rows)


@dataclass(frozen=True, slots=True)
class Push:
    """A step of external torque (n,) [Nm] for a while; times in whole milliseconds of the run."""

    onset_ms: int
    duration_ms: int
    torque: Vector


@dataclass(frozen=True, slots=True)
class Carried:
    """A point mass [kg] in the hand, at a place in the hand's frame (3,) [m]."""

    mass: float
    place: Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """Motion, pushes and load of the arm from the moment it stands."""

    seconds: float
    motion: Motion | Course
    pushes: tuple[Push, ...] = ()
    settling_s: float = 1.5  # from switching on until the arm stands and the recording begins
    begin_s: float = 0.0  # time at which it begins, for the drift of friction
    carried: Carried | None = None
    act: "Act | None" = None  # on the arm at every tick; returns torque on its links (n,) [Nm]


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """Samples of every SYNC, and the truth after every millisecond before it."""

    time_s: Matrix  # (ticks,), from the moment the arm stood
    samples: Matrix
    """(ticks, 4, n): current [A], link position, motor velocity, motor position, by the codec"""
    phi: Matrix  # (milliseconds, n) [rad]; the last of a period is that of its SYNC
    gear_torque: Matrix  # what the gear hands to the link [Nm]
    external: Matrix  # torque on the links in that millisecond [Nm]
    half_gap: Vector  # true alpha (n,) [rad]
    breakaway: Vector  # (n,): most torque that friction of gear and link holds at rest [Nm]

    @property
    def per_tick(self) -> int:
        """Milliseconds of a period."""
        return len(self.phi) // len(self.time_s)

    @property
    def apart(self) -> NDArray[np.bool_]:
        """Milliseconds after which link and rotor do not touch."""
        return np.asarray(np.abs(self.phi) < self.half_gap)

    def at(self, delay_s: float, truth: NDArray[Any]) -> NDArray[Any]:
        """(ticks, n): rows of `truth` from `delay_s` before each SYNC."""
        return truth[self._instants(delay_s)]

    def mean(self, delay_s: float, truth: NDArray[Any]) -> Matrix:
        """(ticks, n): mean of `truth` over the period that ends `delay_s` before each SYNC."""
        total = np.concatenate((np.zeros((1, truth.shape[1])), np.cumsum(truth, axis=0)))
        end = self._instants(delay_s) + 1
        begin = np.maximum(end - self.per_tick, 0)
        mean: Matrix = (total[end] - total[begin]) / (end - begin)[:, np.newaxis]
        return mean

    def _instants(self, delay_s: float) -> NDArray[np.int64]:
        late = round(delay_s / SERVO_PERIOD_S)
        return np.arange(self.per_tick - 1, len(self.phi), self.per_tick) - late


class Harness:
    """The arm in time: `period` moves it on, `sample` reads it, `follow` commands it."""

    def __init__(self, subject: Subject) -> None:
        robot, settings = subject.robot, subject.settings
        c = robot.configuration
        description = describe(robot, read_simulation(robot))
        self.period_s = c.period_s
        self.parameters = true_parameters(description, settings)
        _displace(self.parameters.model, subject.displacement_m, settings.seed)
        self.plant = Plant(
            self.parameters,
            settings.step_s,
            settings.law,
            true_gears(description, settings, self.parameters.torque_constant),
        )
        self.servo = Servo(description, self.parameters.usual_link)
        self.sensors = Sensors(description, settings, self.plant.q)
        self.periods = ServoPeriods(
            self.servo, self.sensors, self.plant.masses, self.parameters.torque_constant
        )
        drives = c.joint_drives
        affine = np.array([[link_side(drive, entry) for drive in drives] for entry in MEASURED])
        self._gain, self._bias = affine[..., 0], affine[..., 1]
        self._encoder = SetpointEncoder(drives)
        gears = np.array([joint.gear for joint in description.joints])
        self._velocity_unit = PROFILE.velocity_unit / gears
        self._steps = round(SERVO_PERIOD_S / settings.step_s)
        self._over_s = self.period_s if subject.interpolates else SERVO_PERIOD_S
        self.per_tick = round(self.period_s / SERVO_PERIOD_S)
        n = self.plant.n
        self.phi, self.gear_torque = np.zeros((2, self.per_tick, n))
        """After each millisecond of the last period."""
        self.sample()  # as drives do when they are switched on

    def energise(self) -> None:
        """All drives on."""
        for joint, velocity in enumerate(self.plant.theta_dot.tolist()):
            self.servo.energise(joint, velocity)

    def sample(self) -> Matrix:
        """Matrix of MEASURED, (4, n)."""
        plant = self.plant
        r = self.sensors.read(plant.q, plant.theta, plant.theta_dot)
        counts = np.array((r.current, r.link_position, r.motor_velocity, r.motor_position))
        values: Matrix = counts * self._gain + self._bias
        return values

    def follow(self, velocity: Vector) -> None:
        """Head for the setpoint (n,) [rad/s] over the next period."""
        for joint, counts in enumerate(self._encoder.encode(velocity)):
            self.servo.follow(joint, counts * self._velocity_unit[joint], self._over_s)

    def run(self, milliseconds: int) -> None:
        """So many milliseconds, without a touch."""
        self.periods.run(milliseconds, self._steps, None)

    def period(self, external: Matrix) -> None:
        """One period; external: torque on the links (per_tick, n) in each of its milliseconds."""
        self.periods.record(external, self._steps, self.phi, self.gear_torque)


Act = Callable[[Harness, float], Vector]
"""Change of the arm at a time [s] of the scenario."""


def _displace(model: pin.Model, distance_m: float, seed: int) -> None:
    """Move every centre of mass by `distance_m`."""
    rng = np.random.default_rng((seed, 2))
    for i in range(1, model.njoints):
        body, away = model.inertias[i], rng.normal(size=3)
        lever = body.lever + distance_m * away / np.linalg.norm(away)
        model.inertias[i] = pin.Inertia(body.mass, lever, body.inertia)


def record(subject: Subject, scenario: Scenario) -> Recording:
    """The whole scenario at once."""
    (recording,) = recordings(subject, scenario, scenario.seconds)
    return recording


def recordings(
    subject: Subject, scenario: Scenario, chunk_s: float = CHUNK_S
) -> Iterator[Recording]:
    """Switch the arm on, let it settle, then the scenario, in pieces of at most `chunk_s`."""
    harness = Harness(subject)
    gain = subject.robot.configuration.control.position_gain
    period_s, per_tick, n = harness.period_s, harness.per_tick, harness.plant.n
    ticks, drift = round(scenario.seconds / period_s), _Drift(subject, n)
    course = scenario.motion.course(ticks, period_s)
    still = np.zeros((per_tick, n))
    harness.plant.scale_friction(drift.at(scenario.begin_s))
    start, velocity = course.q[0], np.zeros(n)
    harness.plant.place(start)
    harness.energise()
    for _ in range(round(scenario.settling_s / period_s)):
        harness.period(still)
        q = harness.sample()[1]
        harness.follow(velocity)
        velocity = gain * (start - q)

    if scenario.carried is not None:
        harness.plant.carry(scenario.carried.mass, scenario.carried.place)
    for first in range(0, ticks, round(chunk_s / period_s)):
        chunk = range(first, min(first + round(chunk_s / period_s), ticks))
        external = _external(scenario.pushes, chunk.start * per_tick, len(chunk) * per_tick, n)
        samples = np.empty((len(chunk), 4, n))
        phi, gear_torque = np.empty((2, len(chunk), per_tick, n))
        for row, tick in enumerate(chunk):
            t = tick * period_s
            if tick % 100 == 0:
                harness.plant.scale_friction(drift.at(scenario.begin_s + t))
            acting = external[row * per_tick : (row + 1) * per_tick]
            if scenario.act is not None:
                acting += scenario.act(harness, scenario.begin_s + t)
            harness.period(acting)
            samples[row] = harness.sample()
            phi[row], gear_torque[row] = harness.phi, harness.gear_torque
            harness.follow(velocity)
            velocity = course.velocity[tick] + gain * (course.q[tick] - samples[row, 1])
        yield Recording(
            time_s=period_s * (1 + np.array(chunk)),
            samples=samples,
            phi=phi.reshape(-1, n),
            gear_torque=gear_torque.reshape(-1, n),
            external=external,
            half_gap=harness.parameters.half_gap,
            breakaway=harness.plant.coulomb.sum(axis=0) * subject.settings.law.stribeck,
        )


def _external(pushes: tuple[Push, ...], begin_ms: int, length_ms: int, n: int) -> Matrix:
    """Torque in each millisecond from `begin_ms` on; pushes add up."""
    external = np.zeros((length_ms, n))
    for push in pushes:
        onset = push.onset_ms - begin_ms
        external[max(onset, 0) : max(onset + push.duration_ms, 0)] += push.torque
    return external


class _Drift:
    """Factor on the friction of each joint, slowly swinging."""

    def __init__(self, subject: Subject, n: int) -> None:
        self._omega = 2.0 * np.pi / subject.drift_period_s
        self._share, self._whole = subject.drift, subject.friction
        self._phase = np.random.default_rng((subject.settings.seed, 3)).uniform(0, 2 * np.pi, n)

    def at(self, t: float) -> Vector:
        swing = 1.0 + self._share * np.sin(self._omega * t + self._phase)
        factor: Vector = self._whole * swing
        return factor
