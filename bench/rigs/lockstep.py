"""The whole program and the simulated arm on one virtual bus, SYNC as the clock: deterministic,
faster than real time. For tests and benches."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from bench.rigs.lines import Line, OpenLine, virtual_line
from daemon.assembly import build_boot, build_tick
from daemon.commands.simulated_robot import describe, read_simulation
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration
from daemon.modes.table import Event, Mode
from daemon.protocol.messages import State
from daemon.tick.tick import Tick
from drivers.boot.boot_up import DriveBoot
from drivers.can.wire import Wire
from simulator.arm import SimulatedArm
from simulator.description import SimulationSettings
from simulator.events import Listener
from simulator.hand import AnyAct
from simulator.lockstep import Lockstep

ROMEO = Path(__file__).parents[2] / "configs" / "romeo_left_arm"
SINGLE_JOINT = ROMEO.parent / "single_joint"
DESK_ARM = ROMEO.parent / "desk_arm"


@dataclass(slots=True)
class Rig:
    """Both ends; `step` moves them on by one period."""

    robot: Robot
    tick: Tick
    arm: SimulatedArm
    lockstep: Lockstep
    line: Line
    boot: DriveBoot
    ticks: int = 0

    @property
    def time_s(self) -> float:
        """Of the next tick."""
        return self.ticks * self.robot.configuration.period_s

    def step(self) -> None:
        """SYNC, answers of the simulated drives, decision, setpoints."""
        self.tick.begin(self.time_s)
        self.lockstep.pump()
        self.tick.finish(0.0)
        self.ticks += 1

    def run(self, seconds: float, each: Callable[[], None] = lambda: None) -> None:
        """Tick for so long; `each` is called after every tick."""
        for _ in range(round(seconds / self.robot.configuration.period_s)):
            self.step()
            each()

    def states(self, seconds: float) -> list[State]:
        """Every State of the next `seconds`."""
        states: list[State] = []
        self.run(seconds, lambda: states.append(self.tick.state()))
        return states

    def request(self, event: Event) -> None:
        """As a person would; raises AssertionError with the reasons of a refusal."""
        reasons = self.tick.controller.request(event, "the bench", self.time_s)
        assert not reasons, reasons

    def enable(self) -> None:
        """Energise, and wait until the arm holds."""
        self.run(0.1)
        self.request(Event.ENABLE)
        self.run(0.5)
        assert self.mode is Mode.HOLDING, (self.mode, self.tick.controller.machine.cause)

    @property
    def mode(self) -> Mode:
        """The controller's."""
        return self.tick.controller.machine.mode


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
    line: OpenLine = virtual_line,
) -> Iterator[Rig]:
    """Boot the simulated arm of `folder` up; `configure` and `simulate` may change both ends, and
    `between` what stands before the daemon's wire. `truth` is the folder whose arm is
    simulated, where the daemon's own believes something else; `line` opens the bus."""
    robot = load_robot(folder)
    true = load_robot(truth) if truth else robot
    simulation = read_simulation(true)
    settings = simulate(simulation.settings)
    description = describe(true, simulation)
    robot = replace(robot, configuration=configure(robot.configuration))
    # One SYNC is one period at both ends, whatever else the true arm is.
    description = replace(description, period_s=robot.configuration.period_s)
    with line() as bus:
        arm = SimulatedArm(description, settings, bus.far.send, hand_script=hand, on_event=on_event)
        lockstep = Lockstep(arm, bus.far)
        arm.power_on()
        tick = build_tick(robot, between(bus.near.wire), lambda: 0.0)
        boot = replace(build_boot(robot, bus.near), listen_s=0.0)
        with lockstep.serving():
            boot.boot_up()
        bus.hand_over()
        tick.drives.start(0.0)
        lockstep.pump()
        yield Rig(robot, tick, arm, lockstep, bus, boot)


def changed(settings: msgspec.Struct, **fields: object) -> msgspec.Struct:
    """A copy of a settings struct with some fields changed."""
    return msgspec.structs.replace(settings, **fields)
