"""Pairs of faults on one arm, judged by the simulated drives: are the daemon's statements true?

The second fault begins while the drives stop because of the first, just after, or once they stand.
Motion is that of the simulated motors, whatever is measured.
"""

import itertools
import os
import pickle
import random
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from typing import Final

from bench.rigs.breakable_arm import BreakableArm, start
from bench.rigs.faults import PLACES, SHOWN, Case
from daemon.modes.table import Event, Mode
from drivers.stopping.stop_watch import VOID_READINGS
from drivers.stopping.witness import MOVES, STANDS
from simulator.axis import Axis

#: All pairs are tried on one rig: two encoders, current, and seven joints.
PLACE: Final = PLACES[0]
#: Ticks from the first to the second fault: most arms are then on their ramps, have just been
#: proved to stand, or have stood for long.
LATER_TICKS: Final = (4, 20, 60)
TICKS: Final = 120
#: Motion [rad] within so many ticks that disproves a reported standstill; a link that reaches the
#: end of its gap knocks its motor for only a tick.
GOES_ON_RAD, GOES_ON_TICKS = 0.006, 6
VOID_TICKS: Final = VOID_READINGS + 10  # Allowed delay until renewed motion is found
#: Left out: cases that differ from others in name or length only, not in what reaches the daemon.
ALIKE: Final = frozenset({
    "under-voltage", "another product in its place", "... and slow to boot", "foreign setpoint",
    "infinite reference", "... for 30 ms", "network down", "stood still for 150 ms",
    "stood still for 3 s", "60 ms late", "SYNC moved by a tool (0x1005)", "... switched on",
})  # fmt: skip
#: Cases that disturb the bus, the machine, or predefined joints: another joint changes nothing.
JOINTLESS: Final = frozenset({
    "PDOs missing in turn", "SYNC lost", "foreign SYNC, or request",
    "foreign NMT command, or disable", "ENOBUFS once",
    "ENOBUFS for 3 ticks", "old frames come back", "error-passive", "bus-off", "... for 80 ms",
    "... for 400 ms", "unheard for 80 ms", "unheard for 400 ms", "current stuck",
    "current at its limit", "pushed beyond a limit", "one late tick", "8 late ticks",
    "stood still for 90 ms", "stood still for 300 ms", "adapter gone",
})  # fmt: skip
SINGLES: Final = tuple(s.case for s in SHOWN if s.place == PLACE and s.case.name not in ALIKE)


@dataclass(frozen=True, slots=True)
class Pair:
    """Two faults in order, on one joint or on two, and `later` ticks between them."""

    first: Case
    second: Case
    apart: bool
    later: int  # ticks

    def __str__(self) -> str:
        where = "another joint" if self.apart else "the same joint"
        return f"{self.first.name} | {self.second.name} {self.later} ticks later ({where})"


PAIRS: Final = tuple(
    Pair(first, second, apart, later)
    for first, second in itertools.permutations(SINGLES, 2)
    for apart in (False, True)
    if not (apart and JOINTLESS & {first.name, second.name})
    for later in LATER_TICKS
)


def sampled(number: int | None, seed: int) -> Sequence[Pair]:
    """Random sample of the pairs; None: all."""
    return PAIRS if number is None else random.Random(seed).sample(PAIRS, number)


@dataclass
class Verdict:
    """False statements about joints, each once, as text."""

    proved: list[str] = field(default_factory=list)  # reported to stand, but moved
    reset: list[str] = field(default_factory=list)  # `reset` would have been accepted meanwhile
    cut: list[str] = field(default_factory=list)  # power removed in motion, without a ramp before

    @property
    def good(self) -> bool:
        """True if all statements were true."""
        return not (self.proved or self.reset or self.cut)


class Judge:
    """Comparison of the daemon's statements with the simulated motors, tick by tick."""

    def __init__(self, on: BreakableArm) -> None:
        self._on, self.verdict = on, Verdict()
        n = len(on.drives)
        self._moving = [0] * n  # ticks of driven motion of a joint proved to stand
        self._at: dict[int, tuple[int, float]] = {}  # joints that were just proved: tick, position
        self._unproved: set[str] = set()
        for joint, drive in enumerate(on.rig.arm.drives):
            self._watch_power(joint, drive.axis)

    def _watch_power(self, joint: int, axis: Axis) -> None:
        obey, on = axis.on_controlword, self._on

        def watched() -> None:
            servo = on.rig.arm.servo
            energised, speed = servo.energised(joint), self._speed(joint)
            obey()
            reported_first = on.rig.drives.stop_failed(joint)
            if energised and not servo.energised(joint) and speed >= MOVES and not reported_first:
                self.verdict.cut.append(f"{self._name(joint)} at {speed:.2f} rad/s")

        axis.on_controlword = watched  # type: ignore[method-assign]

    def _speed(self, joint: int) -> float:
        return abs(float(self._on.rig.arm.plant.theta_dot[joint]))

    def _name(self, joint: int) -> str:
        name: str = self._on.drives[joint].name
        return name

    def see(self) -> None:
        """Judge a tick."""
        rig = self._on.rig
        if rig.mode is not Mode.FAULTED:
            return
        unproved = set(rig.last.unproved)
        for i, drive in enumerate(self._on.drives):
            if drive.name in unproved:
                self._moving[i] = 0
                self._at.pop(i, None)
                continue
            here = float(rig.arm.plant.theta[i])
            if drive.name in self._unproved:
                self._at[i] = rig.ticks, here
            if rig.arm.external_torque[i] or self._holds(i):
                self._at.pop(i, None)  # moved by a hand, directly or through the arm
            goes_on = i in self._at and abs(here - self._at[i][1]) >= GOES_ON_RAD
            if i in self._at and (goes_on or rig.ticks - self._at[i][0] >= GOES_ON_TICKS):
                del self._at[i]
            # A joint at standstill may be pushed by a hand, and is limp without power.
            moves = self._speed(i) >= MOVES and self._drives_itself(i)
            self._moving[i] = self._moving[i] + 1 if moves else max(self._moving[i] - 1, 0)
            if goes_on or self._moving[i] == VOID_TICKS:
                said = f"{drive.name} at {self._speed(i):.2f} rad/s, tick {rig.ticks}"
                self.verdict.proved.append(said)
                self.verdict.reset += [] if unproved else [said]
        self._unproved = unproved

    def end(self) -> None:
        """Judge a reset after silence, which reads from every drive whether it stands."""
        rig = self._on.rig
        moving = self._moving_by_themselves()
        silenced = rig.mode is Mode.FAULTED and rig.tick.drives.silenced
        if silenced and moving and not rig.ask(Event.RESET):
            self.verdict.reset += [f"{name}, in silence" for name in moving]

    def _moving_by_themselves(self) -> list[str]:
        joints = range(len(self._on.drives))
        moves = [i for i in joints if self._speed(i) >= MOVES and self._drives_itself(i)]
        return [self._name(i) for i in moves]

    def _drives_itself(self, joint: int) -> bool:
        """True for an energised motor that no hand pushes and that does not hold."""
        arm = self._on.rig.arm
        energised = bool(arm.servo.energised(joint))
        return energised and not arm.external_torque[joint] and not self._holds(joint)

    def _holds(self, joint: int) -> bool:
        """True for a motor whose velocity loop demands standstill, and works against its motion:
        another link moves it."""
        servo = self._on.rig.arm.servo
        velocity = float(self._on.rig.arm.plant.theta_dot[joint])
        stands = abs(float(servo.reference[joint])) < STANDS
        return bool(servo.energised(joint)) and stands and servo.current[joint] * velocity <= 0.0


def judged(pair: Pair) -> Verdict:
    """Verdict on both faults on an arm of its own."""
    with PLACE.stage() as on:
        return judged_on(on, pair)


def judged_each(pairs: Sequence[Pair]) -> Iterator[tuple[Pair, Verdict]]:
    """Verdict on each pair on a copy of one booted arm, in a process of its own."""
    with PLACE.stage() as on:
        for pair in pairs:
            reader, writer = os.pipe()
            child = os.fork()
            if not child:
                with suppress(BaseException), os.fdopen(writer, "wb") as out:
                    pickle.dump(judged_on(on, pair), out)
                os._exit(0)
            os.close(writer)
            with os.fdopen(reader, "rb") as source:
                answer = source.read()
            os.waitpid(child, 0)
            # A pair without a result, as after an exception, is not a good one.
            yield pair, pickle.loads(answer) if answer else Verdict(["no verdict"])


def judged_on(on: BreakableArm, pair: Pair) -> Verdict:
    """Verdict on both faults on an arm that is off."""
    start(on, armed=pair.first.armed and pair.second.armed)
    judge = Judge(on)
    there = (on.joint + 1) % len(on.drives) if pair.apart else on.joint
    made = ((pair.first, on.joint, 0), (pair.second, there, pair.later))
    with ExitStack() as cleanup:
        faults: list[tuple[Iterator[None], int]] = []
        for tick in range(pair.later + TICKS):
            for case, joint, begins in made:
                if tick == begins:
                    with on.at(joint):
                        faults.append((case.fault(on), joint))
                    cleanup.callback(getattr(faults[-1][0], "close", lambda: None))
            for fault, joint in faults:
                with on.at(joint):
                    next(fault, None)
            if on.rig.tick.fatal:
                on.silence()
            else:
                on.tick()
                judge.see()
        judge.end()
    return judge.verdict
