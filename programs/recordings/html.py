"""Page of a recording: one self-contained HTML file with the curves, uPlot, script and style.

Signals are stored as 16-bit codes between their least and largest value, which exceeds a screen's
resolution: the page of an hour stays below 5 MB.
"""

import base64
import html
import json
import math
from pathlib import Path
from string import Template
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from daemon.protocol.text import printable
from programs.recordings.contents import Contents, EventSeen
from programs.recordings.view import View

_HERE: Final = Path(__file__).parent
_MISSING: Final = -32768
_LARGEST: Final = 32767
_SHOWN_AT_FIRST: Final = 3  # joints whose panels are open at first


def page_of(view: View) -> str:
    """Page as HTML text."""
    return filled("page", view.name, about(view), _data(view))


def filled(page: str, title: str, about: str, data: Any) -> str:
    """Template in `page/` filled with its script, style, data and uPlot."""
    parts = {
        "title": html.escape(printable(title)),
        "about": html.escape(about),
        "data": json.dumps(data, allow_nan=False).replace("<", "\\u003c"),
        "css": _read("page/page.css"),
        "js": _read(f"page/{page}.js"),
        "uplot_css": _read("uplot/uPlot.min.css"),
        "uplot_js": _read("uplot/uPlot.iife.min.js"),
    }
    return Template(_read(f"page/{page}.html")).substitute(parts)


def about(view: View) -> str:
    """Summary of the recording in one line."""
    found = view.contents
    lost = f", {found.lost} states lost" if found.lost else ""
    broken = "; the file breaks off" if view.broken else ""
    return (
        f"{found.duration_s:.2f} s of {len(found.joints)} joints, {len(found.contacts)} contacts, "
        f"{len(found.faults)} faults{lost}{broken}; recorded by {found.program}"
    )


def _read(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")


def _data(view: View) -> dict[str, Any]:
    found, signals = view.contents, view.signals
    first = first_shown(view)
    return {
        "from_s": view.from_s,
        "until_s": view.until_s,
        "at_s": view.at_s,
        "time": _base64(signals.time_s.astype("<f8")),
        "ticks_per_bucket": signals.ticks_per_bucket,
        "modes": [[span.begin_s, span.end_s, span.mode] for span in signals.modes],
        "joints": [
            {
                "name": found.joints[i],
                "shown": i in first,
                "half_gap": view.half_gap[i],
                "signals": {name: _coded(rows[:, i]) for name, rows in signals.values.items()},
            }
            for i in view.joints
        ],
        "contacts": [
            {"time_s": c.time_s, "joint": c.joint, "peak": c.peak} for c in found.contacts
        ],
        "events": [
            {"time_s": e.time_s, "kind": e.kind, "text": printable(e.text)} for e in events_in(view)
        ],
    }


def events_in(view: View) -> list[EventSeen]:
    """Events in the window that is shown."""
    return [e for e in view.contents.events if view.from_s <= e.time_s <= view.until_s]


def first_shown(view: View) -> tuple[int, ...]:
    """Joints whose panels are open at first: those with contacts in the window, else the first."""
    if len(view.joints) <= _SHOWN_AT_FIRST:
        return view.joints
    found: Contents = view.contents
    touched = [
        found.joints.index(c.joint)
        for c in sorted(found.contacts, key=lambda c: -c.clear)
        if c.joint in found.joints and view.from_s <= c.time_s <= view.until_s
    ]
    chosen = [i for i in dict.fromkeys(touched) if i in view.joints]
    return tuple(sorted((chosen or list(view.joints))[:_SHOWN_AT_FIRST]))


def _coded(values: NDArray[np.float32]) -> dict[str, Any]:
    """Signal as 16-bit codes: value = offset + scale * code."""
    known = np.isfinite(values)
    low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0, 0)
    offset, scale = 0.5 * (low + high), (high - low) / (2 * _LARGEST) or 1.0
    if not math.isfinite(scale):
        offset, scale = 0.0, 1.0
    codes = np.full(len(values), _MISSING, dtype="<i2")
    codes[known] = np.clip(np.round((values[known] - offset) / scale), -_LARGEST, _LARGEST)
    return {"offset": offset, "scale": scale, "codes": _base64(codes)}


def _base64(values: NDArray[Any]) -> str:
    return base64.b64encode(values.tobytes()).decode("ascii")
