"""People and programs at the control socket, at random: each a generator of its next requests.

`yield Step(...)` hands over requests and how long it then waits; what comes back is the arm as it
is then. They use neither sockets nor clocks, so that the lockstep part and the real-time part can
both drive them.
"""

import itertools
import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from random import Random

from bench.soak.record import Part
from daemon.config.schema import Configuration
from daemon.modes.table import Mode
from daemon.protocol.guide import AXES, GuideAxes
from daemon.protocol.lease import PERSON_S, PROGRAM_S
from daemon.protocol.replies import Reply
from daemon.protocol.requests import (
    COMMANDS,
    Arm,
    Disarm,
    Follow,
    Go,
    Header,
    Load,
    Renew,
    Request,
    SetGain,
    SetGuide,
    Start,
    Target,
    bare,
)


@dataclass(frozen=True, slots=True)
class View:
    """The arm as a person or a program sees it when it is their turn."""

    mode: Mode
    armed: bool
    trouble: bool  # a fault is being made: no use in `reset`
    q: Sequence[float] = ()  # where its links are [rad]


@dataclass(frozen=True, slots=True)
class Step:
    """Requests on one connection; whether it is closed after them; then a pause."""

    requests: Sequence[Request] = ()
    hang_up: bool = True
    wait_s: float = 1.0


Person = Generator[Step, View, None]

NOTHING = ""
STRAY = [one for one in COMMANDS if one not in ("load", "subscribe", "follow", "target")]
LEASED = (Arm, Renew)  # What a lease begins or goes on with
# What a person wishes for in each mode, and how much more often than something else.
WISHES: dict[Mode, dict[str, float]] = {
    Mode.OFF: {"enable": 8, "stray": 1},
    Mode.ENABLING: {NOTHING: 8, "stray": 1},
    Mode.HOLDING: {"start": 4, "go": 2, "arm": 5, "load": 2, "gain": 1, "disable": 0.5, "stray": 1},
    Mode.TRACKING: {"arm": 6, NOTHING: 6, "pause": 1, "stop": 0.5, "gain": 1, "stray": 1},
    Mode.ADMITTANCE: {NOTHING: 12, "pause": 1, "disarm": 1, "stop": 0.5, "gain": 2, "stray": 0.5},
    Mode.RETRACTING: {NOTHING: 8, "stray": 1},
    Mode.RETURNING: {NOTHING: 8, "stray": 1},
    Mode.RELEASING: {NOTHING: 8, "stop": 0.5, "stray": 1},
    Mode.STOPPING: {NOTHING: 8, "stray": 1},
    Mode.FAULTED: {"reset": 8, "stray": 1},
}


def operator(rng: Random, c: Configuration) -> Person:
    """A person at a command line who keeps the arm busy, and often asks for the impossible."""
    view = yield Step()
    while True:
        wishes = WISHES[view.mode]
        wish = rng.choices(list(wishes), list(wishes.values()))[0]
        if wish == "stray":
            wish = rng.choice(STRAY)
        if wish == "reset" and view.trouble:
            wish = NOTHING
        view = yield Step(_requests(wish, rng, c), wait_s=rng.uniform(0.2, 2.5))


def program(rng: Random, c: Configuration) -> Person:
    """A program that keeps a short lease: it renews a while, then forgets, disarms, or dies."""
    view = yield Step()
    while True:
        if view.mode not in (Mode.HOLDING, Mode.TRACKING):
            view = yield Step(wait_s=rng.uniform(0.5, 2.0))
            continue
        lease_s = rng.choice((None, 0.3, 1.0, 2.0))
        pace_s = 0.3 * (lease_s or 0.5)
        kind: type[Arm | Renew] = Arm
        for _ in range(rng.randrange(1, 40)):
            view = yield Step((kind(lease_s=lease_s),), hang_up=False, wait_s=pace_s)
            if not view.armed:
                break
            kind = Renew
        end = rng.choice(("forgets", "disarms", "dies"))
        if end == "forgets":
            view = yield Step(hang_up=False, wait_s=2.0)
        last = (Disarm(),) if end == "disarms" else ()
        view = yield Step(last, wait_s=rng.uniform(0.5, 8.0))


def leader(rng: Random, c: Configuration) -> Person:
    """A program that streams targets, with losses and leaps, until it ends, hangs, or dies."""
    view = yield Step()
    while True:
        if view.mode is not Mode.HOLDING or not view.q:
            view = yield Step(wait_s=rng.uniform(1.0, 10.0))
            continue
        begun, number, pace_s = list(view.q), 0, rng.choice((0.01, 0.02, 0.05))
        sent_s = rng.uniform(0.0, 1e6)
        view = yield Step((Follow(q=begun, sent_s=sent_s),), hang_up=False, wait_s=pace_s)
        joint, way = rng.randrange(len(begun)), rng.uniform(-0.3, 0.3)
        for _ in range(rng.randrange(1, 400)):
            number, sent_s = number + 1, sent_s + pace_s
            q = list(begun)
            q[joint] += way * math.sin(0.7 * pace_s * number)
            if rng.random() < 0.01:
                q[joint] = rng.uniform(-9.0, 9.0)
            late_s = rng.choice((0.0, 0.0, -1.0)) if rng.random() < 0.02 else 0.0
            target = Target(q=q, sent_s=sent_s + late_s, number=number)
            lost = rng.random() < 0.05
            view = yield Step(() if lost else (target,), hang_up=False, wait_s=pace_s)
        if rng.random() < 0.5:
            view = yield Step(hang_up=False, wait_s=1.0)
        view = yield Step(wait_s=rng.uniform(2.0, 20.0))


def _requests(  # noqa: PLR0911 - one for each wish
    wish: str, rng: Random, c: Configuration
) -> tuple[Request, ...]:
    match wish:
        case "":
            return ()
        case "arm":
            return (Arm(lease_s=rng.choice((None, 1.0, 5.0, 20.0)), detached=True),)
        case "gain" if rng.random() < 0.3:
            return (SetGuide(axes=GuideAxes(damped=tuple(a for a in AXES if rng.random() < 0.3))),)
        case "gain":
            joint = rng.choice(c.joints)
            gain = rng.choice((-1.0, 1e9, *(rng.uniform(0.2, 1.5) * joint.admittance_gain,) * 8))
            return (SetGain(joint=joint.name, gain=gain),)
        case "go":
            joint = rng.choice(c.joints)
            # One in some is out of its limits.
            value = rng.uniform(1.1 * joint.limits.lower, 1.1 * joint.limits.upper)
            speed = rng.choice((None, 0.5, 2.0))
            return (Go(targets={joint.name: value}, speed=speed),)
        case "load":
            return _trajectory(rng, c)
        case _:
            return (bare(wish),)  # type: ignore[arg-type]  # all others are commands as they are


def _trajectory(rng: Random, c: Configuration) -> tuple[Request, ...]:
    """There and back of one joint, from where it stands; one in five too fast, or out of limits."""
    joint = rng.choice(c.joints)
    way = rng.choice((-1, 1)) * rng.choice((0.05, 0.1, 0.1, 0.1, 3.0))
    header = Header(name="soak.csv", joints=[joint.name], from_here=True)
    end_s, n = rng.uniform(2.0, 6.0), 40
    # A cosine: position and velocity at (n + 1) moments.
    shape = [(i / n, *_cosine(i / n)) for i in range(n + 1)]
    rows = [[end_s * x, way * p, way * v / end_s] for x, p, v in shape]
    loads = [Load(rows=list(chunk)) for chunk in _by(rows, 30)]
    return (Load(header=header), *loads, Start(loaded=True))


def _cosine(x: float) -> tuple[float, float]:
    """x^2 (1 - x)^2, scaled to a height of 1: there and back, at rest at both ends."""
    return 16.0 * x**2 * (1.0 - x) ** 2, 32.0 * x * (1.0 - x) * (1.0 - 2.0 * x)


def _by(rows: list[list[float]], size: int) -> list[list[list[float]]]:
    return [rows[i : i + size] for i in range(0, len(rows), size)]


def explained(reply: Reply) -> bool:
    """True for a refusal that gives its reason."""
    return reply.ok or bool(reply.reasons) or not reply.message.endswith("refused")


HEARD_TICKS = 2  # Ticks until the daemon has seen that an owner is gone, however many wait
LAPSES_TICKS = 1  # The lease is looked at after each tick


def hear(part: Part, request: Request, reply: Reply, mode: Mode | None, time_s: float) -> None:
    """Take note of an answer, and check what holds for all of them."""
    part.counts[f"{request.command} {'done' if reply.ok else 'refused'}"] += 1
    words = f"{request.command} in {mode}: {reply.message} {reply.reasons}"
    if not reply.ok:
        part.ledger.refusal = words
    part.ledger.check("a refusal has its reasons", explained(reply), time_s, words)
    always = request.command not in ("stop", "disarm") or reply.ok
    part.ledger.check("stop and disarm are never refused", always, time_s, words)


class Leases:
    """Until when the arm may be armed, from what was asked and answered."""

    def __init__(self) -> None:
        self._until_s = -1.0
        self._holder = 0
        self._asked: dict[int, Arm | Renew] = {}  # by connection: may be granted at any moment
        self._numbers = itertools.count(1)
        self.ticks = LAPSES_TICKS  # For how many ticks it may still be armed after that.

    def connection(self) -> int:
        """A number for a new connection."""
        return next(self._numbers)

    @property
    def until_s(self) -> float:
        """The latest time until which the arm may be armed."""
        return math.inf if self._asked else self._until_s

    def asked(self, request: Request, connection: int) -> None:
        """A lease may be granted before its answer is read."""
        if isinstance(request, LEASED):
            self._asked[connection] = request

    def answered(self, request: Request, reply: Reply, connection: int, time_s: float) -> None:
        """A lease that was granted counts from when its answer is there."""
        self._asked.pop(connection, None)
        if isinstance(request, LEASED) and reply.ok:
            self._until_s, self.ticks = time_s + _duration_s(request), LAPSES_TICKS
            self._holder = 0 if _is_detached(request) else connection

    def closed(self, connection: int, time_s: float) -> None:
        """A connection is over, perhaps before an answer came: what it asked for may have been
        granted until now, and will not be any more."""
        asked = self._asked.pop(connection, None)
        if asked is not None and _is_detached(asked):
            self._until_s = max(self._until_s, time_s + _duration_s(asked))
        elif asked is not None and (connection == self._holder or self._until_s < time_s):
            self._until_s, self.ticks = time_s, HEARD_TICKS
        elif connection == self._holder:
            self._until_s, self.ticks = min(self._until_s, time_s), HEARD_TICKS


def _is_detached(request: Arm | Renew) -> bool:
    return isinstance(request, Arm) and request.detached


def _duration_s(request: Arm | Renew) -> float:
    return request.lease_s or (PERSON_S if _is_detached(request) else PROGRAM_S)
