"""Lockstep of the whole program and the simulated arm on one virtual bus, SYNC as the clock:
deterministic, faster than real time. For tests and benches."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench.rigs.guardian_at_bus import GuardianAtBus
from bench.rigs.lines import Line, LockstepBus, OpenLine, virtual_line
from bench.rigs.sync_clock import AnsweredWire, Lockstep, at_request, at_sync
from common.errors import DriveError
from daemon.arming.checks import ArmingChecks
from daemon.assembly import build_arming_checks, build_tick
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration
from daemon.drives import build_boot, build_canopen, build_motors
from daemon.modes.table import Event, Mode
from daemon.protocol.replies import Check
from daemon.protocol.state import State
from daemon.service.set_up import SetUp
from daemon.tick.decision import Decision
from daemon.tick.loop import Clock
from daemon.tick.telemetry import TickRecord, Wakeup, state_of
from daemon.tick.tick import Tick
from drivers.api import Samples
from drivers.can.wire import Wire
from drivers.canopen.arm import CanopenArm
from drivers.canopen.boot.boot_up import DriveBoot
from drivers.canopen.settings import CanopenProfile
from drivers.makes import guardian_of
from drivers.motors.arm import MotorArm
from estimator.estimate import Estimate
from programs.simulate.simulated_robot import describe, read_simulation
from simulator.arm import SimulatedArm
from simulator.description import ArmDescription, SimulationSettings
from simulator.events import Listener
from simulator.hand_script import AnyAct
from simulator.truth import SimulationFile

ROMEO = Path(__file__).parents[2] / "configs" / "romeo_left_arm"
SINGLE_JOINT = ROMEO.parent / "single_joint"
DESK_ARM = ROMEO.parent / "desk_arm"
OPENARM = ROMEO.parent / "openarm_left"
BEAM = ROMEO.parent / "beam_arm"

#: Of an arm whose configuration is right by construction.
TRUSTED = Check(name="identification", passed=True, text="none; the configuration is trusted")
WALL_S = 1.8e9  # Unix time of the first tick


class Ticking:
    """Tick of the daemon that a rig moves on by `step`, and what it came to."""

    robot: Robot
    tick: Tick
    arming: ArmingChecks
    ticks: int

    @property
    def time_s(self) -> float:
        """Time of the next tick [s]."""
        return self.ticks * self.robot.configuration.period_s

    def step(self) -> None:
        """One tick."""
        raise NotImplementedError

    def run(self, seconds: float, each: Callable[[], None] = lambda: None) -> None:
        """Tick for so long; `each` is called after every tick."""
        for _ in range(round(seconds / self.robot.configuration.period_s)):
            self.step()
            each()

    @property
    def mode(self) -> Mode:
        """The controller's."""
        return self.tick.controller.machine.mode

    @property
    def last(self) -> TickRecord:
        """The last tick; AssertionError before the first."""
        assert self.tick.last is not None
        return self.tick.last

    @property
    def estimate(self) -> Estimate:
        """The newest; AssertionError before the first complete samples."""
        assert self.last.estimate is not None
        return self.last.estimate

    def permit(self, who: str = "the bench") -> list[str]:
        """Arm as the daemon does for a client; returns every reason why not."""
        reasons = self.arming.run(self.time_s).reasons
        return list(reasons) or self.tick.controller.arm(who)


@dataclass(slots=True)
class Rig(Ticking):
    """Both ends of the bus; `step` moves them on by one period."""

    robot: Robot
    drives: Any  # CanopenArm, or an arm of motors
    tick: Tick
    arming: ArmingChecks
    arm: SimulatedArm
    lockstep: Lockstep
    line: Line
    build: Callable[[Robot], tuple[Any, Tick, ArmingChecks]]  # drives set up, their tick
    ticks: int = 0
    before_s: float = 0.0  # time of the ticks that were built before this one
    guard: Callable[[], None] = lambda: None  # a turn of the guardian, where there is one

    @property
    def wall_s(self) -> float:
        """Unix time of the next tick."""
        return WALL_S + self.before_s + self.time_s

    def take_up(self, robot: Robot) -> None:
        """End as the daemon does, and begin anew by another robot. Raises ContactdError."""
        with self.by_sdo(), suppress(DriveError):
            self.drives.disable_monitoring()
        self.drives.end()
        self.before_s, self.ticks = self.before_s + self.time_s, 0
        self.drives, self.tick, self.arming = self.build(robot)
        self.robot = robot

    def step(self, wall_s: float | None = None) -> None:
        """SYNC, answers of the simulated drives, decision, setpoints; `wall_s` is the Unix time,
        which otherwise passes like the rig's."""
        self.tick.begin(self.time_s)
        self.lockstep.pump()
        self.guard()
        wall_s = self.wall_s if wall_s is None else wall_s
        self.tick.finish(0.0, Wakeup(wall_s=wall_s))
        self.ticks += 1

    def states(self, seconds: float) -> list[State]:
        """Every State of the next `seconds`."""
        states: list[State] = []
        self.run(seconds, lambda: states.append(self.state()))
        return states

    def request(self, event: Event) -> None:
        """Request an event as a person would; AssertionError with the reasons of a refusal."""
        reasons = self.tick.controller.request(event, "the bench", self.time_s)
        assert not reasons, reasons

    def enable(self) -> None:
        """Energise, and wait until the arm holds."""
        self.run(0.1)
        self.request(Event.ENABLE)
        self.run(0.5)
        assert self.mode is Mode.HOLDING, (self.mode, self.tick.controller.machine.cause)

    @contextmanager
    def by_sdo(self) -> Iterator[None]:
        """The drives answer SDO inside the block, while no tick happens."""
        try:
            with self.lockstep.serving():
                yield
        finally:
            self.line.hand_over()

    @property
    def set_up(self) -> SetUp:
        """Set-up of the drives, as the daemon proves it for its clients."""
        return SetUp(self.drives, self.tick, lambda: self.time_s, asking=self.by_sdo)

    def ask(self, event: Event) -> list[str]:
        """Request an event as a client would, `enable` and `reset` with the set-up proved; returns
        every reason why not."""
        return self.set_up.request(event, "the bench")

    def reset(self) -> None:
        """Reset a fault as a client would, asked again while the arm is not seen to stand;
        AssertionError unless the arm is off after it, and stays so."""
        assert self.tick.controller.faulted, self.mode
        for _ in range(100):
            if self.drives.master_timeout_passed or not self.drives.unproved():
                break
            self.run(0.01)
        reasons = self.ask(Event.RESET)
        assert not reasons, reasons
        self.run(0.6)
        assert self.mode is Mode.OFF, (self.mode, self.tick.controller.machine.cause)

    @property
    def boot(self) -> DriveBoot:
        """Set-up of CANopen drives by SDO."""
        boot: DriveBoot = self.drives.boot
        return boot

    @property
    def samples(self) -> Samples:
        """Samples of the last tick."""
        return self.last.samples

    @property
    def decision(self) -> Decision:
        """Decision of the last tick; AssertionError before the first complete samples."""
        assert self.last.decision is not None
        return self.last.decision

    def state(self) -> State:
        """State of the last tick, as it is published."""
        return state_of(self.last)

    def clock(self) -> Clock:
        """For a loop around the tick: time passes by `step` alone."""
        return Clock(lambda: self.time_s, lambda _: None, lambda: self.wall_s)


@contextmanager
def lockstep_rig(
    folder: Path = ROMEO,
    *,
    configure: Callable[[Configuration], Configuration] = lambda c: c,
    simulate: Callable[[SimulationSettings], SimulationSettings] = lambda s: s,
    hand: tuple[AnyAct, ...] = (),
    on_event: Listener = lambda _: None,
    between: Callable[[Wire], Wire] = lambda wire: wire,
    truth: Path | None = None,
    identification: Callable[[Robot, list[int | None]], Check] = lambda robot, serials: TRUSTED,
    line: OpenLine = virtual_line,
    described: Callable[[Robot, SimulationFile], ArmDescription] = describe,
) -> Iterator[Rig]:
    """Boot the simulated arm of `folder` up; `configure` and `simulate` may change both ends, and
    `between` what stands before the daemon's wire. `truth` is the folder whose arm is simulated,
    where the daemon's own believes something else, and `identification` the arming check for the
    robot and the drives' serial numbers. `line` opens the bus. `described`
    is the arm of that folder: as its configuration says, unless stated otherwise."""
    robot = load_robot(folder)
    true = load_robot(truth) if truth else robot
    simulation = read_simulation(true)
    settings = simulate(simulation.settings)
    description = described(true, simulation)
    robot = replace(robot, configuration=configure(robot.configuration))
    # One SYNC is one period at both ends, whatever else the true arm is.
    description = replace(description, period_s=robot.configuration.period_s)
    is_canopen = isinstance(next(iter(robot.configuration.drives.values())), CanopenProfile)
    phase_of = at_sync if is_canopen else at_request(robot)
    with line() as bus:
        arm = SimulatedArm(description, settings, bus.far.send, hand_script=hand, on_event=on_event)
        lockstep = Lockstep(arm, bus.far, phase_of)
        arm.power_on()

        def canopen(robot: Robot) -> CanopenArm:
            boot = replace(build_boot(robot, bus.near.wire), listen_s=0.0, sleep=lockstep.let_pass)
            with lockstep.serving():
                boot.boot_up()
            bus.hand_over()
            return build_canopen(robot, boot, between(bus.wire), lambda: 0.0)

        def motors(robot: Robot) -> MotorArm:
            c = robot.configuration
            wire, bitrate = between(AnsweredWire(bus.wire, lockstep)), c.bus.bitrate
            drives = build_motors(wire, c.joint_drives, c.period_s, lambda: 0.0, bitrate, 0.0)
            with lockstep.serving():
                drives.boot_up(lambda line: None)
            bus.hand_over()
            return drives

        def build(robot: Robot) -> tuple[Any, Tick, ArmingChecks]:
            drives = canopen(robot) if is_canopen else motors(robot)
            check = identification(robot, drives.serials)
            tick = build_tick(robot, drives, check)
            drives.start(0.0)
            lockstep.pump()
            return drives, tick, build_arming_checks(robot, tick, check)

        guardian = guardian_of(robot.configuration.joint_drives)
        if guardian is None:
            yield Rig(robot, *build(robot), arm, lockstep, bus, build)
            return
        with LockstepBus(bus.channel) as end:
            guard = GuardianAtBus(guardian, end, arm)
            yield Rig(robot, *build(robot), arm, lockstep, bus, build, guard=guard)
