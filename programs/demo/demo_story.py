"""Evaluation of the demonstration: checks and figures from States and the hand's acts. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from daemon.config.schema import Configuration
from daemon.modes.table import Mode
from daemon.protocol.state import Snapshot, State, Wrench
from programs.clients.wrench import force_words, wrench_words
from simulator.hand_script import Press, Script

# Time in which the residual decays and the arm swings back through its gaps after the release [s].
AFTER_TOUCH_S = 0.3
BEFORE_S = 0.05
# Longest allowed delay from the start of a push to its contact [s].
PROMPT_S = 0.5
# Least distance over which the hand must have led the arm [rad].
LED_AT_LEAST = 0.15
# Tolerance of the quiet time, which is counted in ticks that may be late [s].
QUIET_SLACK_S = 0.02


@dataclass(frozen=True, slots=True)
class Touch:
    """Time during which the hand touched the arm [s, CLOCK_MONOTONIC]; force and end of its initial
    press on the tool."""

    begin_s: float
    end_s: float
    force_N: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pressed_until_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Check:
    """One expected outcome."""

    what: str
    happened: bool
    figure: str


def touch_of(events: Sequence[dict[str, Any]], script: Script = ()) -> Touch | None:
    """Touch, from the hand's first act to its release, by the simulator's events."""
    times = [(e["monotonic_s"], e["text"]) for e in events if e["kind"] == "hand"]
    begins = [t for t, text in times if text.startswith("begin")]
    ends = [t for t, text in times if text == "begin release"]
    if not begins or not ends:
        return None
    touch = Touch(begins[0], ends[0])
    if script and isinstance(first := script[0], Press) and first.duration_s:
        return replace(touch, force_N=first.force, pressed_until_s=begins[0] + first.duration_s)
    return touch


def percentiles(values: Sequence[float]) -> dict[str, float]:
    """Percentiles p50, p99 and max, rounded to 0.1."""
    p50, p99 = np.percentile(values, [50, 99])
    return {"p50": round(p50, 1), "p99": round(p99, 1), "max": round(max(values), 1)}


class RunFigures:
    """Figures of one run, computed from its States."""

    def __init__(
        self,
        configuration: Configuration,
        snapshot: Snapshot,
        states: Sequence[State],
        touch: Touch | None,
    ) -> None:
        self._c, self._snapshot, self._states, self._touch = (
            configuration,
            snapshot,
            states,
            touch,
        )

    @property
    def modes(self) -> list[tuple[float, str]]:
        """Mode changes as (time [s], mode)."""
        changes: list[tuple[float, str]] = []
        for state in self._states:
            if not changes or changes[-1][1] != state.mode:
                changes.append((round(state.time_s, 3), state.mode))
        return changes

    @property
    def contacts(self) -> list[dict[str, Any]]:
        """Contacts that the daemon reported."""
        return [
            {
                "t_s": round(state.time_s, 3),
                "joint": event.contact.joint,
                "torque_nm": round(event.contact.torque, 3),
            }
            for state in self._states
            for event in state.notices
            if event.contact and event.contact.level == "contact"
        ]

    @property
    def faults(self) -> list[str]:
        """Faults that the daemon reported, latched or not."""
        notices = [notice for state in self._states for notice in state.notices]
        return [notice.text for notice in notices if notice.kind == "fault"]

    def touched(self, state: State) -> bool:
        """True if the hand touched the arm, or had just released it."""
        touch, now = self._touch, state.timing.monotonic_s
        return touch is not None and touch.begin_s <= now <= touch.end_s + AFTER_TOUCH_S

    @property
    def false_contacts(self) -> dict[str, int]:
        """Number of times that a residual exceeded its threshold without a hand on the energised
        arm, for the residual that decides and for the others computed on the same samples."""
        counts = {"backlash": 0, **dict.fromkeys(self._states[0].beside, 0)}
        above = {name: np.zeros(len(self._snapshot.joints), dtype=bool) for name in counts}
        for state in self._states:
            if state.mode not in (Mode.HOLDING, Mode.TRACKING):
                continue
            threshold = np.array(state.threshold)
            for name, values in {"backlash": state.residual, **state.beside}.items():
                now = np.abs(values) > threshold
                if not self.touched(state):
                    counts[name] += int(np.count_nonzero(now & ~above[name]))
                above[name] = now
        return counts

    @property
    def _resume(self) -> int | None:
        """Index of the first State in tracking after admittance."""
        pairs = zip(self._states, self._states[1:], strict=False)
        for i, (before, after) in enumerate(pairs, start=1):
            if before.mode == Mode.ADMITTANCE and after.mode == Mode.TRACKING:
                return i
        return None

    @property
    def quiet_s(self) -> float:
        """Time from the last tick with a non-zero thresholded residual to the resumption [s]."""
        if (resume := self._resume) is None:
            return 0.0
        for state in reversed(self._states[:resume]):
            if any(state.thresholded):
                return self._states[resume].time_s - state.time_s
        return 0.0

    @property
    def resume_jump(self) -> float:
        """Largest change of a setpoint from one tick to the next in the second after the
        resumption, relative to the one that the acceleration limit allows."""
        return max(self._jumps() / (self._acceleration * self._c.period_s), default=0.0)

    @property
    def resume_jump_rad_s(self) -> float:
        """Largest change of a setpoint from one tick to the next, as above [rad/s]."""
        return float(max(self._jumps(), default=0.0))

    def _jumps(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        if (resume := self._resume) is None:
            return np.zeros(len(self._c.joints))
        rows = np.array([state.setpoint for state in self._states[resume - 1 : resume + 100]])
        jumps: np.ndarray[Any, np.dtype[np.float64]] = np.abs(np.diff(rows, axis=0)).max(axis=0)
        return jumps

    @property
    def _acceleration(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.array([joint.limits.acceleration for joint in self._c.joints])

    def _led(self) -> float:
        """Largest displacement of a joint by the hand [rad]."""
        guided = [state for state in self._states if state.mode == Mode.ADMITTANCE]
        if not guided:
            return 0.0
        moved = np.array(guided[-1].link_position) - np.array(guided[0].link_position)
        return float(np.abs(moved).max())

    @property
    def said(self) -> Wrench | None:
        """Estimated force at the tool shortly before the press ends; None without one."""
        until = self._touch.pressed_until_s if self._touch else 0.0
        last = [s for s in self._states if s.timing.monotonic_s < until - BEFORE_S]
        return last[-1].wrench if last else None

    def force(self, frame: str) -> str:
        """Words on the true and the estimated force of the push; empty without a press."""
        if self._touch is None or (said := self.said) is None:
            return ""
        true = force_words(self._touch.force_N, frame)
        return f"the hand pushed with {true}; contactd estimated {wrench_words(said, frame)}"

    def checks(self) -> list[Check]:
        """Checks of all expected outcomes, in order."""
        names = [mode for _, mode in self.modes]
        touch = self._touch
        detected_s = next(
            (
                state.timing.monotonic_s - touch.begin_s
                for state in self._states
                if touch and state.mode == Mode.ADMITTANCE
            ),
            None,
        )
        quiet, wanted = self.quiet_s, self._c.admittance.quiet_s
        false = self.false_contacts
        ours = false.pop("backlash")
        rest = [f", {n} with the {name} one without backlash" for name, n in false.items()]
        story = [Mode.TRACKING, Mode.ADMITTANCE, Mode.TRACKING]
        begins = names.index(Mode.TRACKING) if Mode.TRACKING in names else len(names)
        lateness = self._c.period_s + QUIET_SLACK_S
        return [
            Check(
                "the arm tracked, yielded, and tracked again",
                names[begins : begins + 3] == story,
                " > ".join(names),
            ),
            Check(
                "the push was detected",
                detected_s is not None and 0.0 <= detected_s <= PROMPT_S,
                "never"
                if detected_s is None
                else f"{detected_s * 1000:.0f} ms after the hand began",
            ),
            Check("the hand led the arm", self._led() >= LED_AT_LEAST, f"{self._led():.2f} rad"),
            Check(
                f"it continued after {wanted:g} quiet seconds",
                wanted - 1e-3 <= quiet <= wanted + lateness,
                f"{quiet:.3f} s",
            ),
            Check(
                "it continued without a jump",
                self._resume is not None and self.resume_jump <= 1.001,
                f"{self.resume_jump_rad_s:.4f} rad/s in a tick",
            ),
            Check("no false contact", ours == 0, f"{ours} with this residual{''.join(rest)}"),
            Check("no fault was latched", Mode.FAULTED not in names, ", ".join(self.faults)),
        ]

    def report(self, *, ended_well: bool) -> dict[str, Any]:
        """Object that `contactd demo --json` prints."""
        timing = [state.timing for state in self._states]
        return {
            "ticks": len(self._states),
            "missed": timing[-1].missed - timing[0].missed,
            "lateness_us": percentiles([t.lateness_us for t in timing]),
            "tick_us": percentiles([t.work_us for t in timing[1:]]),
            "modes": self.modes,
            "contacts": self.contacts,
            "force_N": self._touch.force_N if self._touch else None,
            "wrench": msgspec.to_builtins(self.said),
            "false_contacts": self.false_contacts,
            "quiet_s": round(self.quiet_s, 4),
            "resume_jump_rad_s": round(self.resume_jump_rad_s, 6),
            "pass": ended_well and all(check.happened for check in self.checks()),
        }
