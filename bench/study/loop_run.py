"""Measurements of `bench.loop`: the loop's workers on both codes in turns, and beside them a
control thread that does nothing."""

import contextlib
import math
import multiprocessing
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench.study.pairs import Ratio, Sides, Worker, in_turns, ratio, sides
from bench.study.wakeups import Distribution, Rival, a_rival
from daemon.modes.table import Mode
from daemon.tick.loop import deadlines_left_out

# Of one side's turn: long enough for its median, short enough that both sides meet one machine.
TURN_S: Final = 5
SETTLING_S: Final = 2  # enabled, started, and long since swaying
MOST_REPEATS: Final = 5  # of a turn, where the machine stalls
FIRST_TICKS: Final = 5  # of each turn, left out: the other side's code is in the caches
FIGURES: Final = ("lateness_us", "cpu_us", "work_us", "setpoint_us")
#: Figures of which the ratio to before is taken: of their medians, and of their 99th percentiles.
COMPARED: Final = ("cpu_us", "setpoint_us")


@dataclass(frozen=True, slots=True)
class Turn:
    """One turn of one side, in a row of ticks."""

    figures: dict[str, NDArray[np.float64]]
    missed: int
    rival_us: Distribution | None
    """lateness of the control thread beside it"""
    mode: str
    joints: int
    realtime: list[str]
    repeated: int = 0
    """how often it was: the machine stalled, and the arm stopped for that"""

    def after(self, stopped: "Turn") -> "Turn":
        """This turn in the place of one in which the arm stopped: ticks of an arm that stands cost
        less. What was missed in that one counts."""
        assert self.rival_us is not None
        assert stopped.rival_us is not None
        return replace(
            self,
            missed=self.missed + stopped.missed,
            rival_us=self.rival_us + stopped.rival_us,
            repeated=stopped.repeated + 1,
        )

    def stopped_by_machine(self, hz: int) -> bool:
        """True if the arm stopped, and even the control thread beside it woke up later than a
        period: the machine stalled."""
        stalled = self.rival_us is not None and self.rival_us.beyond(1e6 / hz) > 0
        return stalled and self.mode != Mode.TRACKING


@dataclass(frozen=True, slots=True)
class Run:
    """One run of one arm at one rate."""

    hz: int
    joints: int
    seconds: float
    realtime: list[str]
    mode: str  # tracking, or the first other that a turn ended in: something was wrong
    missed: int
    drift_us: float
    lateness_us: Distribution
    cpu_us: Distribution  # of the loop's thread, without the recorded drives
    work_us: Distribution  # from wake-up to the last frame sent, with the recorded drives
    setpoint_us: Distribution  # from the drives' answers to SYNC to the last setpoint
    rival: str  # what woke up beside it
    rival_us: Distribution | None
    to_before: dict[str, Ratio]  # empty without a code before
    rival_threads: int = 1
    repeated: int = 0  # turns of today in which the machine stalled and the arm stopped
    waited: bool = True  # for its deadlines: lateness and work are of real time

    @property
    def rivals_missed(self) -> float:
        """Deadlines that a rival's late wake-ups would have cost the loop, mean of its threads."""
        if self.rival_us is None:
            return 0.0
        late = zip(self.rival_us.values.tolist(), self.rival_us.counts.tolist(), strict=True)
        cost = sum(count * deadlines_left_out(us * 1e-6 * self.hz) for us, count in late)
        return float(cost / self.rival_threads)

    @property
    def rivals_late(self) -> float:
        """Wake-ups of the rival later than a period, mean of its threads."""
        late = 0 if self.rival_us is None else self.rival_us.beyond(1e6 / self.hz)
        return late / self.rival_threads

    def data(self) -> dict[str, Any]:
        """Measurements for JSON."""
        return {
            "joints": self.joints,
            "seconds": self.seconds,
            "ticks": int(self.lateness_us.counts.sum()),
            "missed": self.missed,
            "repeated": self.repeated,
            "mode": self.mode,
            "realtime": self.realtime,
            "lateness_us": self.lateness_us.data(),
            "rival": self.rival,
            "rival_us": self.rival_us.data() if self.rival_us else None,
            "rivals_missed": self.rivals_missed,
            "cpu_us": self.cpu_us.data(),
            "work_us": self.work_us.data(),
            "setpoint_us": self.setpoint_us.data(),
            "drift_us": round(self.drift_us, 1),
            "to_before": {name: found.data() for name, found in self.to_before.items()},
        }


def measure(hz: int, seconds: int, before: Path | None, *, load: bool, waits: bool = True) -> Run:
    """Run the daemon's loop against recorded drives, both codes in turns: in real time, or, if it
    does not wait, tick by tick as fast as they come."""
    with contextlib.ExitStack() as stack:
        found: Sides = stack.enter_context(
            sides("loop", before, lambda _: {"hz": hz, "waits": waits})
        )
        rival = stack.enter_context(a_rival(hz)) if waits else None
        missed = {worker: worker.ask(ticks=SETTLING_S * hz)["missed"] for worker in found.both()}
        if load:
            stack.enter_context(hogs(2 * (os.cpu_count() or 1)))
        turn_s = min(TURN_S, seconds)

        def once(worker: Worker) -> Turn:
            made = _turn(worker, turn_s, hz, rival, missed[worker])
            missed[worker] += made.missed
            return made

        def turn(worker: Worker) -> Turn:
            made = once(worker)
            while made.stopped_by_machine(hz) and made.repeated < MOST_REPEATS:
                worker.begin_anew()
                missed[worker] = worker.ask(ticks=SETTLING_S * hz)["missed"]
                made = once(worker).after(made)
            return made

        today, then = in_turns(found, math.ceil(seconds / turn_s), turn)
    name, threads = ("", 1) if rival is None else (rival.name, rival.threads)
    return run_of(hz, today, then, rival=name, threads=threads, waited=waits)


def _turn(worker: Worker, seconds: int, hz: int, rival: Rival | None, missed: int) -> Turn:
    if rival is not None:
        rival.begin(seconds)
    answer = worker.ask(ticks=seconds * hz)
    return Turn(
        figures={name: np.array(answer[name][FIRST_TICKS:]) for name in FIGURES},
        missed=answer["missed"] - missed,
        rival_us=None if rival is None else rival.result(),
        mode=answer["mode"],
        joints=answer["joints"],
        realtime=answer["realtime"],
    )


def run_of(
    hz: int,
    today: Sequence[Turn],
    before: Sequence[Turn],
    *,
    rival: str,
    waited: bool,
    threads: int = 1,
) -> Run:
    """Figures of all turns together, and their ratios turn by turn."""
    whole = {name: np.concatenate([turn.figures[name] for turn in today]) for name in FIGURES}
    beside = [turn.rival_us for turn in today if turn.rival_us is not None]
    third = len(whole["lateness_us"]) // 3
    drift = np.median(whole["lateness_us"][-third:]) - np.median(whole["lateness_us"][:third])
    return Run(
        hz=hz,
        joints=today[-1].joints,
        seconds=len(today) * (len(today[0].figures["cpu_us"]) + FIRST_TICKS) / hz,
        realtime=today[-1].realtime,
        mode=next((turn.mode for turn in today if turn.mode != Mode.TRACKING), Mode.TRACKING),
        missed=sum(turn.missed for turn in today),
        repeated=sum(turn.repeated for turn in today),
        drift_us=abs(float(drift)),
        lateness_us=Distribution.of(whole["lateness_us"]),
        cpu_us=Distribution.of(whole["cpu_us"]),
        work_us=Distribution.of(whole["work_us"]),
        setpoint_us=Distribution.of(whole["setpoint_us"]),
        rival=rival,
        rival_threads=threads,
        rival_us=sum(beside[1:], beside[0]) if beside else None,
        to_before=to_before(today, before),
        waited=waited,
    )


def to_before(today: Sequence[Turn], before: Sequence[Turn]) -> dict[str, Ratio]:
    """Ratios of today's turns to those before, by figure and percentile; empty without those."""
    if not before:
        return {}
    return {
        f"{name.removesuffix('_us')} p{percent}": ratio(
            [
                (_at(mine, name, percent), _at(other, name, percent))
                for mine, other in zip(today, before, strict=True)
            ]
        )
        for name in COMPARED
        for percent in (50, 99)
    }


def _at(turn: Turn, name: str, percent: float) -> float:
    return float(np.nanpercentile(turn.figures[name], percent))


def resident(before: Path | None, seconds: float) -> dict[str, dict[str, float]]:
    """Memory [kB] of `contactd run` once it serves, and its growth over `seconds`, of both codes
    at once; by side."""
    with sides("resident", before, lambda _: {}) as found:
        workers = dict(zip(("today", "before"), found.both(), strict=False))
        first = {side: worker.ask(seconds=0.0) for side, worker in workers.items()}
        for worker in workers.values():
            worker.send({"seconds": seconds})
        last = {side: worker.receive() for side, worker in workers.items()}
    return {side: _growth(first[side], last[side]) for side in workers}


def _growth(first: dict[str, float], last: dict[str, float]) -> dict[str, float]:
    return last | {f"{name} grown": last[name] - first[name] for name in last}


@contextlib.contextmanager
def hogs(count: int) -> Iterator[None]:
    """Processes that do nothing else than take CPU time, with an ordinary priority."""
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
