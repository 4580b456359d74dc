"""States that the rules of the soak are tried on."""

from collections.abc import Iterable
from typing import Any

from bench.rigs.lockstep import ROMEO
from bench.soak.invariants import Watch
from bench.soak.record import Ledger, Part
from bench.soak.report import failures
from daemon.config.load import load_robot
from daemon.protocol.state import Notice, PerJoint, State, Timing

C = load_robot(ROMEO).configuration
MIDDLE = [(joint.limits.lower + joint.limits.upper) / 2 for joint in C.joints]
GIVES_WAY = 0.02
Scene = tuple[State, bool, bool]  # with a hand, with a fault being made


def state(tick: int, **changes: Any) -> State:
    n = len(C.joints)
    vectors = {name: [0.0] * n for name, of in State.__annotations__.items() if of == PerJoint}
    plain: dict[str, Any] = {
        **vectors,
        "tick": tick,
        "time_s": 0.01 * tick,
        "interval_s": 0.01,
        "mode": "holding",
        "armed": False,
        "cause": "",
        "moving": False,
        "fresh": [True] * n,
        "drives": [""] * n,
        "link_position": MIDDLE,
        "motor_position": None,
        "side": [""] * n,
        "touched_link": "",
        "beside": {},
        "flags": [],
        "quiet_s": 0.0,
        "notices": [],
        "timing": Timing(wall_s=0.0, monotonic_s=0.0, lateness_us=0.0, work_us=0.0, missed=0),
    }
    return State(**{**plain, **changes})


def first(value: float, others: list[float] | None = None) -> list[float]:
    rest = others or [0.0] * len(C.joints)
    return [value, *rest[1:]]


def notices(text: str) -> list[Notice]:
    return [Notice(kind="mode", text=text)]


def ledger_of(scenes: Iterable[Scene]) -> Ledger:
    """Findings of the rules on these States."""
    ledger = Ledger()
    watch = Watch(C, ledger, GIVES_WAY)
    for each, touched, trouble in scenes:
        watch.see(each, lease_until_s=0.5, lease_ticks=1, touched=touched, trouble=trouble)
    return ledger


def broken_by(states: Iterable[State]) -> set[str]:
    """Rules that these States break, by no hand and no fault; each is a reason to fail."""
    ledger = ledger_of((each, False, False) for each in states)
    failed = failures([Part("x", 1, ledger=ledger)])
    assert [line.partition(", ")[0] for line in failed] == [f"x: {rule}" for rule in ledger.broken]
    return set(ledger.broken)
