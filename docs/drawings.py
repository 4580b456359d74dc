"""Drawings of docs/concepts.md and docs/following.md as SVG, written by `make reference`.

Schematic, and drawn by a few functions here, so that a change of a picture is a change of a number.
"""

import math
import random
from collections.abc import Sequence

import numpy as np

from common.arrays import Vector
from daemon.motion.playout import Playout, Target
from daemon.motion.tracker import Tracker

INK, MOTOR, LINK, LEVEL, FELT = "#222", "#2b6cb0", "#c05621", "#718096", "#fbd38d"
_STYLE = "font-family='sans-serif' font-size='14'"


def drawings() -> dict[str, str]:
    """SVG by the name of its file."""
    return {
        "gap.svg": gap(),
        "contact.svg": contact(),
        "session.svg": session(),
        "stream.svg": stream(),
    }


# --- the gap of a joint -----------------------------------------------------------------------


def gap() -> str:
    """Motor and link of a joint in the three states of its gap."""
    half, pin = 60.0, 10.0
    panels = (
        ("left", -half, "motor and link touch:", "torque goes through"),
        ("gap", 15.0, "nothing touches:", "the link is on its own"),
        ("right", half, "they touch again,", "on the other side"),
    )
    parts: list[str] = []
    for i, (name, phi, *words) in enumerate(panels):
        middle = 130.0 + 240.0 * i
        inside = half + pin  # the link touches with its side, and counts by its middle
        fork = [(-inside - 14, 150), (-inside - 14, 60), (-inside, 60), (-inside, 130)]
        fork += [(-x, y) for x, y in reversed(fork)]
        parts += [
            _polygon([(middle + x, y) for x, y in fork], MOTOR),
            _rectangle(middle + phi - pin, 30, 2 * pin, 92, LINK),
            _line(middle, 60, middle, 182, MOTOR, dashed=True),
            _text(middle, 198, "theta", MOTOR),
            _text(middle + phi, 22, "q", LINK),
            _text(middle, 226, f"side: {name}", INK, bold=True),
            *(_text(middle, 248 + 18 * k, line) for k, line in enumerate(words)),
        ]
    parts += [
        _arrow(130, 100, 130 - half, 100, INK),
        _arrow(130 - half, 100, 130, 100, INK),
        _text(165, 95, "half-gap"),
        _text(
            370, 292, "phi = q - theta: where in its gap a joint is; from -half-gap to +half-gap"
        ),
    ]
    return _svg(740, 305, parts)


# --- from residual to yielding ----------------------------------------------------------------

_PUSHED_S, _LET_GO_S, _END_S, _QUIET_S = 3.0, 6.0, 10.0, 2.0
_CONTACT, _COLLISION = 1.0, 2.6


def residual(t: float) -> float:
    """Residual [of its level] in the drawing: noise, and a hand from 3 to 6 s."""
    noise = 0.18 * math.sin(9.1 * t) + 0.12 * math.sin(23.0 * t + 1.0)
    if not _PUSHED_S < t < _LET_GO_S:
        return noise
    return noise + 1.9 * math.sin(math.pi * (t - _PUSHED_S) / (_LET_GO_S - _PUSHED_S)) ** 0.7


def contact() -> str:
    """A residual, its levels, and the modes that the arm goes through."""
    left, width, base, unit = 110.0, 600.0, 200.0, 55.0

    def at(t: float, r: float) -> tuple[float, float]:
        return left + width * t / _END_S, base - unit * r

    curve = [(0.02 * k, residual(0.02 * k)) for k in range(501)]
    beyond = [(t, r) for t, r in curve if r > _CONTACT]
    began, ended = beyond[0][0], beyond[-1][0]
    area = [
        at(began, _CONTACT),
        *(at(t, max(r, _CONTACT)) for t, r in curve if began <= t <= ended),
    ]
    parts = [
        _polygon([*area, at(ended, _CONTACT)], FELT),
        _line(*at(0, 0), *at(_END_S, 0), INK),
        *(
            _line(*at(0, level), *at(_END_S, level), LEVEL, dashed=True)
            for level in (_CONTACT, _COLLISION)
        ),
        _polyline([at(t, r) for t, r in curve], LINK),
        _text(left - 8, at(0, 0)[1] + 5, "0", anchor="end"),
        _text(left - 8, at(0, _CONTACT)[1] + 5, "contact", anchor="end"),
        _text(left - 8, at(0, _COLLISION)[1] + 5, "collision", anchor="end"),
        _text(*at(1.2, 0.45), "residual", LINK),
        _text(*at(ended + 0.3, 1.45), "beyond it: thresholded residual", anchor="start"),
        _text(*at(0.5 * (began + ended), 2.25), "a hand pushes"),
    ]
    bands = (
        (0.0, began, "tracking", "#bee3f8"),
        (began, ended, "admittance", FELT),
        (ended, ended + _QUIET_S, "quiet for 2 s", "#fefcbf"),
        (ended + _QUIET_S, _END_S, "tracking", "#bee3f8"),
    )
    for start, end, words, colour in bands:
        x, wide = at(start, 0)[0], width * (end - start) / _END_S
        parts += [_rectangle(x, 245, wide, 34, colour), _text(x + wide / 2, 267, words)]
    parts += [_text(left - 8, 267, "mode", anchor="end"), _text(left + width / 2, 300, "time")]
    return _svg(740, 312, parts)


# --- a session --------------------------------------------------------------------------------


def session() -> str:
    """Commands of a usual session, and the modes that they lead to."""
    y, tall = 60.0, 50.0
    boxes = {"off": 30.0, "holding": 225.0, "tracking": 420.0, "admittance": 615.0}
    wide = 110.0
    parts: list[str] = []
    for name, x in boxes.items():
        parts += [
            _rectangle(x, y, wide, tall, "#bee3f8" if name != "admittance" else FELT),
            _text(x + wide / 2, y + 30, name, bold=True),
        ]
    ways = (
        ("off", "holding", "enable", "disable"),
        ("holding", "tracking", "start, go", "pause, stop"),
        ("tracking", "admittance", "a hand", "quiet for 2 s"),
    )
    for one, other, there, back in ways:
        begin, end = boxes[one] + wide, boxes[other]
        parts += [
            _arrow(begin, y + 15, end, y + 15, INK),
            _arrow(end, y + 38, begin, y + 38, INK),
            _text((begin + end) / 2, y + 6, there),
            _text((begin + end) / 2, y + 58, back),
        ]
    parts += [
        _text(670, y + 84, "only while armed"),
        _text(370, 30, "armed: a permission beside the mode, with an end; arm, disarm", LINK),
        _text(370, 190, "From everywhere: stop, and a fault, which latches until reset."),
    ]
    return _svg(740, 205, parts)


# --- pieces -----------------------------------------------------------------------------------


def _svg(width: int, height: int, parts: Sequence[str]) -> str:
    head = f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width} {height}' {_STYLE}>"
    return "\n".join([head, _rectangle(0, 0, width, height, "white"), *parts, "</svg>"]) + "\n"


def _points(points: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _polygon(points: Sequence[tuple[float, float]], fill: str) -> str:
    return f"<polygon points='{_points(points)}' fill='{fill}'/>"


def _polyline(points: Sequence[tuple[float, float]], colour: str) -> str:
    return f"<polyline points='{_points(points)}' fill='none' stroke='{colour}' stroke-width='2'/>"


def _rectangle(x: float, y: float, width: float, height: float, fill: str) -> str:
    return (
        f"<rect x='{x:.1f}' y='{y:.1f}' width='{width:.1f}' height='{height:.1f}' fill='{fill}'/>"
    )


def _line(
    x: float, y: float, to_x: float, to_y: float, colour: str, *, dashed: bool = False
) -> str:
    dashes = " stroke-dasharray='6 4'" if dashed else ""
    ends = f"x1='{x:.1f}' y1='{y:.1f}' x2='{to_x:.1f}' y2='{to_y:.1f}'"
    return f"<line {ends} stroke='{colour}'{dashes}/>"


def _arrow(x: float, y: float, to_x: float, to_y: float, colour: str) -> str:
    back = math.copysign(8.0, x - to_x)
    tip = [(to_x, to_y), (to_x + back, to_y - 4), (to_x + back, to_y + 4)]
    return _line(x, y, to_x, to_y, colour) + _polygon(tip, colour)


def _text(
    x: float, y: float, words: str, colour: str = INK, *, bold: bool = False, anchor: str = "middle"
) -> str:
    weight = " font-weight='bold'" if bold else ""
    place = f"x='{x:.1f}' y='{y:.1f}' text-anchor='{anchor}'"
    return f"<text {place} fill='{colour}'{weight}>{words}</text>"


# --- a stream of targets ----------------------------------------------------------------------

_RATE_HZ, _TICK_S, _BEFORE_S, _SHOWN_S = 50.0, 0.01, 2.0, 1.2
_LIMITS = np.array([1.2]), np.array([4.0])  # [rad/s], [rad/s2]


def stream() -> str:
    """Targets of a leader with jitter and losses, and the setpoint that they become."""
    chance = random.Random(5)
    sent = [k / _RATE_HZ for k in range(round((_BEFORE_S + _SHOWN_S) * _RATE_HZ))]
    arrivals = sorted(
        (s + chance.uniform(0.0, 0.01), k, s) for k, s in enumerate(sent) if chance.random() > 0.05
    )
    _, number, first_s = arrivals.pop(0)
    playout = Playout(Target(number, first_s, _leader(first_s)), 0.0)
    tracker = Tracker(_leader(first_s), _LIMITS[1])
    dots, setpoint = [], []
    for tick in range(1, round((_BEFORE_S + _SHOWN_S) / _TICK_S)):
        now_s = tick * _TICK_S
        while arrivals and arrivals[0][0] <= now_s:
            arrived_s, number, s = arrivals.pop(0)
            playout.put(Target(number, s, _leader(s)), now_s)
            dots.append((arrived_s, float(_leader(s)[0])))
        playout.step(now_s, _TICK_S)
        reference = tracker.step(*playout.read(), _LIMITS[0], _TICK_S)
        setpoint.append((now_s, float(reference.q[0])))
    seen = [(t - _BEFORE_S, q) for t, q in setpoint if t >= _BEFORE_S]
    came = [(t - _BEFORE_S, q) for t, q in dots if t >= _BEFORE_S]
    return _stream_picture(came, seen, playout.delay_s)


def _leader(s: float) -> Vector:
    """Motion of the leader [rad] at time s [s]."""
    return np.array([0.25 * math.sin(2.0 * math.pi * 0.5 * s)])


def _stream_picture(
    targets: Sequence[tuple[float, float]], setpoint: Sequence[tuple[float, float]], delay_s: float
) -> str:
    def place(t: float, q: float) -> tuple[float, float]:
        return 50.0 + 560.0 * t / _SHOWN_S, 130.0 - 380.0 * q

    shown = [place(t, q) for t, q in setpoint]
    parts = [
        _line(50, 130, 610, 130, LEVEL),
        *(
            f"<circle cx='{x:.1f}' cy='{y:.1f}' r='3' fill='{LINK}'/>"
            for x, y in (place(t, q) for t, q in targets)
        ),
        _polyline(shown, MOTOR),
        _text(500, 205, "targets, as they come", LINK),
        _text(500, 225, f"setpoint, {1e3 * delay_s:.0f} ms behind the leader", MOTOR),
        _text(330, 262, f"{_SHOWN_S:g} s, 0.5 rad from top to bottom"),
    ]
    return _svg(660, 275, parts)
