"""A person who stops and disarms the arm while others besiege its socket, and how long that takes.

Ticks are counted from before the person connects, by the daemon's clock, which is the machine's.
"""

import random
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from bench.rigs.rude_clients import attacking
from daemon.clients.client import Client
from daemon.modes.table import Mode
from daemon.protocol.messages import Reply, State
from errors import ContactdError

EFFECT_TICKS = 2
_AGAIN_S = 0.03  # between two attempts to let the arm move, or to arm it
_SEED = 7
_AFTERWARDS = 20  # ticks in which the last effect is seen

Stop = Literal["stop", "disarm"]


@dataclass(slots=True)
class Stops:
    """Ticks from each stop to its effect, and how many came to nothing."""

    ticks: dict[Stop, list[int]] = field(default_factory=lambda: {"stop": [], "disarm": []})
    unserved: int = 0

    @property
    def number(self) -> int:
        """How many there were, of both kinds; 0 where one kind is missing."""
        return sum(map(len, self.ticks.values())) if all(self.ticks.values()) else 0

    def p(self, percent: float) -> float:
        """Percentile of the ticks of both; infinite if one came to nothing, or there was none."""
        every = [*self.ticks["stop"], *self.ticks["disarm"]]
        return float(np.percentile(every, percent)) if every and not self.unserved else np.inf

    def figures(self) -> dict[str, Any]:
        """Percentiles and counts, by kind."""
        return {
            kind: {"number": len(ticks)}
            | {f"p{p}": float(np.percentile(ticks, p)) for p in (50, 99, 100) if ticks}
            for kind, ticks in self.ticks.items()
        } | {"unserved": self.unserved}

    def __str__(self) -> str:
        words = [f"{kind} {figures}" for kind, figures in self.figures().items()]
        return "ticks to effect: " + "; ".join(words)


def besieged_person(
    path: Path, states: Iterator[State], attack: str | None, seconds: float
) -> Stops:
    """Stops and disarms of `seconds`, under `attack`. The arm is enabled before, and disabled at
    the end."""
    sent: list[tuple[float, Stop]] = []
    stops, over = Stops(), threading.Event()
    _insist(path, "enable", over)
    with attacking(attack, path):
        person = threading.Thread(target=_live, args=(path, sent, stops, over))
        person.start()
        taken = [next(states)]
        while taken[-1].time_s < taken[0].time_s + seconds:
            taken.append(next(states))
        over.set()
        while person.is_alive():
            taken.append(next(states))
        taken += [next(states) for _ in range(_AFTERWARDS)]
    _insist(path, "disable", threading.Event())
    for sent_s, kind in sent:
        stops.ticks[kind].append(_ticks_to_effect(taken, sent_s, kind))
    return stops


def _live(path: Path, sent: list[tuple[float, Stop]], stops: Stops, over: threading.Event) -> None:
    chance = random.Random(_SEED)
    while not over.is_set():
        for allow, stop in (("arm", "disarm"), ("start", "stop")):
            if not _insist(path, allow, over):
                return
            time.sleep(chance.uniform(0.05, 0.1))
            sent_s = time.monotonic()
            try:
                with Client(path) as client:
                    done = client.request(stop).ok  # type: ignore[arg-type]
            except ContactdError:
                done = False
            if done:
                sent.append((sent_s, stop))  # type: ignore[arg-type]
            else:
                stops.unserved += 1


def _insist(path: Path, command: Any, over: threading.Event) -> bool:
    """Ask until it is done, unless it is over."""
    while not over.is_set():
        try:
            with Client(path, timeout_s=10.0) as client:
                reply: Reply = (
                    client.arm(detached=True) if command == "arm" else client.request(command)
                )
        except ContactdError:
            continue
        if reply.ok:
            return True
        time.sleep(_AGAIN_S)
    return False


def _ticks_to_effect(states: list[State], sent_s: float, kind: Stop) -> int:
    before = [s for s in states if s.timing.monotonic_s <= sent_s][-1]
    for state in states[states.index(before) + 1 :]:
        done = not state.armed if kind == "disarm" else state.mode != Mode.TRACKING
        if done:
            return state.tick - before.tick
    raise ValueError("the recording ends before the effect")
