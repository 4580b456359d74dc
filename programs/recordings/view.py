"""View of a recording: the part that a plot shows, selected by joints, time and window.

view = read_view(path, joints=("LElbowYaw",), around="contact:2")
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from common.errors import LogError
from daemon.protocol.state import Snapshot, State
from daemon.protocol.text import printable
from programs.clients.log_reader import read_batches
from programs.recordings.contents import Contents
from programs.recordings.reading import read_contents
from programs.recordings.signals import DRAWN, SignalGatherer, Signals

POINTS_BYTES: Final = 3_200_000  # size of all signals in a page, before base64 adds a third
_VALUE_BYTES: Final = 2
_BY_NUMBER: Final = ("contact", "fault")
AROUND: Final = re.compile(r"\d+(\.\d*)?|\.\d+|(contact|fault)(:[1-9]\d{0,5})?", re.ASCII)


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Data of a plot. `joints` are columns of the signals."""

    name: str
    contents: Contents
    signals: Signals
    half_gap: tuple[float, ...]
    joints: tuple[int, ...]
    from_s: float
    until_s: float
    at_s: float | None = None
    """Time in question."""
    state: State | None = None
    """State of the last tick up to that time."""
    broken: str = ""
    """Reason why the recording ends early."""


def read_view(
    path: Path,
    joints: Sequence[str] = (),
    around: str = "",
    window_s: float = 5.0,
    progress: Callable[[float], None] = lambda share: None,
) -> View:
    """Read a recording; `around` must match AROUND: "12.3" [s], "contact:2", "fault" (the first),
    "fault:2". An event needs a second pass. `joints`: names or numbers from 1, by default all.

    Raises LogError for a file that cannot be read, or an unknown joint or event.
    """
    at_s = _time_of(path, around) if around else None
    from_s, until_s = -math.inf, math.inf
    if at_s is not None:
        from_s, until_s = at_s - 0.5 * window_s, at_s + 0.5 * window_s
    contents, half_gap = Contents(), tuple[float, ...]()
    gatherer: SignalGatherer | None = None
    state: State | None = None

    def take(batch: Snapshot | list[State]) -> None:
        nonlocal half_gap, gatherer, state
        if isinstance(batch, Snapshot):
            _refuse_other_arm(path, contents.joints, batch)
            contents.add_snapshot(batch)
            half_gap = tuple(batch.half_gap)
            gatherer = gatherer or _gatherer(path, batch, joints, from_s, until_s)
            return
        assert gatherer is not None
        contents.add(batch)
        gatherer.add(batch)
        if at_s is not None:
            state = _latest(batch, contents, at_s) or state

    broken = read_batches(path, take, progress)
    assert gatherer is not None
    if at_s is not None and state is None:
        raise LogError(f"{path} has no state at {at_s:g} s: it lasts {contents.duration_s:.2f} s")
    return View(
        name=path.name,
        contents=contents,
        signals=gatherer.signals(),
        half_gap=half_gap,
        joints=_chosen(contents.joints, joints),
        from_s=max(from_s, 0.0),
        until_s=min(until_s, contents.duration_s),
        at_s=at_s,
        state=state,
        broken=broken,
    )


def _refuse_other_arm(path: Path, before: tuple[str, ...], snapshot: Snapshot) -> None:
    if before not in ((), tuple(snapshot.joints)):
        raise LogError(f"{path} contains recordings of two arms")
    if not snapshot.joints or len(snapshot.half_gap) != len(snapshot.joints):
        raise LogError(
            f"{path} is damaged: {len(snapshot.half_gap)} half-gaps for {len(snapshot.joints)} "
            "joints"
        )


def _gatherer(
    path: Path, snapshot: Snapshot, joints: Sequence[str], from_s: float, until_s: float
) -> SignalGatherer:
    """Gatherer with as many buckets as fit into a page."""
    shown = len(_chosen(tuple(snapshot.joints), joints))
    points = POINTS_BYTES // (_VALUE_BYTES * len(DRAWN) * shown + 8)
    return SignalGatherer(len(snapshot.joints), points // 4, from_s, until_s)


def _latest(states: Sequence[State], contents: Contents, at_s: float) -> State | None:
    """Last of these States up to a time, or None."""
    begun = contents.begun_s or 0.0
    until = [s for s in states if s.time_s - begun <= at_s + 1e-9]
    return until[-1] if until and at_s <= contents.duration_s + 1.0 else None


def _chosen(known: tuple[str, ...], asked: Sequence[str]) -> tuple[int, ...]:
    """Columns of the joints asked for, by name or by number from 1."""
    found = []
    for name in asked or known:
        if name in known:
            found.append(known.index(name))
        elif name.isdecimal() and 1 <= int(name) <= len(known):
            found.append(int(name) - 1)
        else:
            raise LogError(f"--joint {name}: no such joint; there are: {', '.join(known)}")
    return tuple(dict.fromkeys(found))


def _time_of(path: Path, around: str) -> float:
    """Time [s] that `around` means in a recording."""
    kind, _, number = around.partition(":")
    if kind not in _BY_NUMBER:
        return float(around)
    contents, _ = read_contents(path)
    times = [one.time_s for one in (contents.contacts if kind == "contact" else contents.faults)]
    if len(times) < (which := int(number or 1)):
        has = f"{len(times)} {kind}{'s' if len(times) != 1 else ''}" if times else f"no {kind}"
        raise LogError(f"--around {kind}:{which}: the recording has {has}")
    return times[which - 1]


def said_at(view: View) -> list[str]:
    """Lines of text on all joints shown, at the time in question."""
    state, at_s = view.state, view.at_s
    if state is None or at_s is None:
        return []
    armed = ", armed" if state.armed else ""
    lines = [f"at {at_s:.2f} s: {state.mode}{armed} ({printable(state.cause)})"]
    lines += [
        f"  fault: {printable(one.text)}" for one in view.contents.faults if one.time_s == at_s
    ]
    for i in view.joints:
        beyond = " beyond its threshold" if state.thresholded[i] else ""
        lines.append(
            f"  {view.contents.joints[i]:16} residual {state.residual[i]:+.3f} Nm{beyond}, "
            f"threshold {state.threshold[i]:.3f} Nm in force; {state.link_velocity[i]:+.3f} rad/s, "
            f"{state.current[i]:+.3f} A, phi {1e3 * state.phi[i]:+.2f} +- "
            f"{1e3 * state.phi_sigma[i]:.2f} mrad ({state.side[i]})"
        )
    if state.touched_link:
        lines.append(f"  touched: at least the link of {printable(state.touched_link)}")
    return lines
