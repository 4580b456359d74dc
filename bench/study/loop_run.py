"""Measurements of `bench.loop`: the loop in turns of some seconds, beside an idle thread."""

import contextlib
import math
import multiprocessing
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench.rigs.lockstep import ROMEO
from bench.rigs.processes import pair
from bench.soak.process import held
from bench.study.loop_session import FIGURES, Session
from bench.study.wakeups import Cyclictest, Distribution, a_rival
from daemon.modes.table import Mode
from daemon.tick.loop import skipped_deadlines

TURN_S: Final = 5  # a stall of the machine invalidates one turn
SETTLING_S: Final = 2  # enabled, started, and in steady motion
MOST_REPEATS: Final = 5  # of a turn in which the machine stalls
FIRST_TICKS: Final = 5  # of each turn, left out: the caches hold other code


@dataclass(frozen=True, slots=True)
class Turn:
    """Consecutive ticks."""

    figures: dict[str, NDArray[np.float64]]
    missed: int
    missed_so_far: int  # by this process of the loop
    rival_us: Distribution | None  # lateness of the control thread beside it
    mode: str
    joints: int
    realtime: list[str]
    repeated: int = 0  # times: the machine stalled, which stopped the arm

    def after(self, stopped: "Turn") -> "Turn":
        """This turn, in place of one in which the arm stopped, as ticks of an arm at rest cost
        less. Deadlines missed in that one count."""
        assert self.rival_us is not None
        assert stopped.rival_us is not None
        return replace(
            self,
            missed=self.missed + stopped.missed,
            rival_us=self.rival_us + stopped.rival_us,
            repeated=stopped.repeated + 1,
        )

    def stopped_by_machine(self, hz: int) -> bool:
        """True if the arm stopped, and even the idle thread woke up later than a period: the
        machine stalled."""
        stalled = self.rival_us is not None and self.rival_us.beyond(1e6 / hz) > 0
        return stalled and self.mode != Mode.TRACKING


@dataclass(frozen=True, slots=True)
class Run:
    """One run of one arm at one rate."""

    hz: int
    joints: int
    seconds: float
    realtime: list[str]
    mode: str  # tracking, or the first other one in which a turn ended, which is an error
    missed: int
    drift_us: float
    lateness_us: Distribution
    cpu_us: Distribution  # of the loop's thread, without the recorded drives
    work_us: Distribution  # from wake-up to the last frame sent, with the recorded drives
    setpoint_us: Distribution  # from the drives' answers to SYNC to the last setpoint
    rival: str  # control beside it
    rival_us: Distribution | None
    rival_threads: int = 1
    repeated: int = 0  # turns in which the machine stalled and the arm stopped
    waited: bool = True  # for its deadlines: lateness and work are in real time

    @property
    def rivals_missed(self) -> float:
        """Deadlines that the control's late wake-ups would have cost the loop, mean of threads."""
        if self.rival_us is None:
            return 0.0
        late = zip(self.rival_us.values.tolist(), self.rival_us.counts.tolist(), strict=True)
        cost = sum(count * skipped_deadlines(us * 1e-6 * self.hz) for us, count in late)
        return float(cost / self.rival_threads)

    @property
    def rivals_late(self) -> float:
        """Wake-ups of the control later than a period, mean of its threads."""
        late = 0 if self.rival_us is None else self.rival_us.beyond(1e6 / self.hz)
        return late / self.rival_threads

    def data(self) -> dict[str, Any]:
        """Measurements for JSON."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}
        found |= {"drift_us": round(self.drift_us, 1), "rivals_missed": self.rivals_missed}
        found["ticks"] = int(self.lateness_us.counts.sum())
        return {k: v.data() if isinstance(v, Distribution) else v for k, v in found.items()}


def measure(hz: int, seconds: int, *, load: bool, waits: bool = True) -> Run:
    """Run of the daemon's loop against recorded drives: in real time, or, if it does not wait, tick
    by tick as fast as possible."""
    with contextlib.ExitStack() as stack:
        session = stack.enter_context(contextlib.closing(Session(hz, waits=waits)))
        rival = stack.enter_context(a_rival(hz)) if waits else None
        missed = session.ask(SETTLING_S * hz)["missed"]
        if load:
            stack.enter_context(hogs(2 * (os.cpu_count() or 1)))
        turn_s = min(TURN_S, seconds)
        turns = []
        for _ in range(math.ceil(seconds / turn_s)):
            made = _turn(session, turn_s, hz, rival, missed)
            while made.stopped_by_machine(hz) and made.repeated < MOST_REPEATS:
                session.begin_anew()
                missed = session.ask(SETTLING_S * hz)["missed"]
                made = _turn(session, turn_s, hz, rival, missed).after(made)
            turns.append(made)
            missed = made.missed_so_far
    name, threads = ("", 1) if rival is None else (rival.name, rival.threads)
    return run_of(hz, turns, rival=name, threads=threads, waited=waits)


def _turn(session: Session, seconds: int, hz: int, rival: Cyclictest | None, missed: int) -> Turn:
    if rival is not None:
        rival.begin(seconds)
    answer = session.ask(seconds * hz)
    return Turn(
        figures={name: np.array(answer[name][FIRST_TICKS:]) for name in FIGURES},
        missed=answer["missed"] - missed,
        missed_so_far=answer["missed"],
        rival_us=None if rival is None else rival.result(),
        mode=answer["mode"],
        joints=answer["joints"],
        realtime=answer["realtime"],
    )


def run_of(hz: int, turns: Sequence[Turn], *, rival: str, waited: bool, threads: int = 1) -> Run:
    """Figures of all turns together."""
    whole = {name: np.concatenate([turn.figures[name] for turn in turns]) for name in FIGURES}
    beside = [turn.rival_us for turn in turns if turn.rival_us is not None]
    third = len(whole["lateness_us"]) // 3
    drift = np.median(whole["lateness_us"][-third:]) - np.median(whole["lateness_us"][:third])
    return Run(
        hz=hz,
        joints=turns[-1].joints,
        seconds=len(turns) * (len(turns[0].figures["cpu_us"]) + FIRST_TICKS) / hz,
        realtime=turns[-1].realtime,
        mode=next((turn.mode for turn in turns if turn.mode != Mode.TRACKING), Mode.TRACKING),
        missed=sum(turn.missed for turn in turns),
        repeated=sum(turn.repeated for turn in turns),
        drift_us=abs(float(drift)),
        **{name: Distribution.of(whole[name]) for name in FIGURES},
        rival=rival,
        rival_threads=threads,
        rival_us=sum(beside[1:], beside[0]) if beside else None,
        waited=waited,
    )


def resident(seconds: float) -> dict[str, float]:
    """Memory [kB] of `contactd run` once it serves, and its growth over `seconds`."""
    with pair(ROMEO) as both:
        client, _, states = both.subscribed()
        next(states)
        client.close()
        first = held(both.daemon.pid)
        time.sleep(seconds)
        last = held(both.daemon.pid)
    names = {"resident_kB": "resident memory", "anonymous_kB": "memory (anonymous)"}
    found = {name: last[of] for name, of in names.items()}
    return found | {f"{name} grown": last[of] - first[of] for name, of in names.items()}


@contextlib.contextmanager
def hogs(count: int) -> Iterator[None]:
    """Processes of ordinary priority that only take CPU time."""
    processes = [multiprocessing.Process(target=_burn, daemon=True) for _ in range(count)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()


def _burn() -> None:
    while True:
        pass
