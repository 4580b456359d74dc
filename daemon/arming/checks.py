"""Arming checks: conditions for the arm to yield to contact, each passed or failed.

They evaluate the record of the last tick, between two ticks. History that this record does not
contain is kept by `daemon.tick.recent`. No I/O; time is an argument.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from common.arrays import Vector
from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.modes.table import ARMABLE, Mode, refusal
from daemon.motion.limits import Limits
from daemon.protocol.lease import SENSES_S
from daemon.protocol.replies import Check
from daemon.tick.recent import LATE_TICKS
from daemon.tick.sensing import HARMLESS
from daemon.tick.telemetry import FLAG_NAMES, TickRecord
from daemon.tick.tick import Tick
from drivers.api import DriveCondition, Objection, Samples
from estimator.estimate import Estimate

#: In the order in which they are shown, after the mode.
NAMES = (
    "drives",
    "samples",
    "heartbeats",
    "emergencies",
    "set-up",
    "identification",
    "parameters",
    "estimator",
    "thresholds",
    "residual",
    "limits",
    "loop",
    "faults",
)

# Checks that depend on the samples of a tick.
SAMPLED = frozenset(
    {"drives", "heartbeats", "set-up", "estimator", "thresholds", "residual", "limits"}
)

# More than LATE_TICKS late ticks within this time are too many [s].
LATE_WITHIN_S = 1.0
# Largest threshold in force of a joint, over its configured contact level. At rest, friction hides
# external torque: with the smallest level that is identified, a hundredth of the motor's torque,
# the ratio reaches 4.7 on the arms in `configs/`. Beyond, friction decides what is detected, which
# the configured level does not suggest.
RAISED = 5.0
# Between two ticks the last one is at most a period old; a thousandth of it is for rounding.
OLDEST = 1.001  # periods


@dataclass(frozen=True, slots=True)
class ArmingResult:
    """Result of all arming checks at one moment."""

    checks: tuple[Check, ...]  # the mode, then NAMES; only the mode before the first samples
    reasons: tuple[str, ...]  # all reasons against arming, in the order of finding; empty: arm


class ArmingChecks:
    """Arming checks of one arm."""

    def __init__(
        self, tick: Tick, limits: Limits, period_s: float, settled: Sequence[Check], contact: Vector
    ) -> None:
        """settled: checks whose result is fixed for the whole run: `identification`, of the
        identified values against the drives that answered, and `parameters`. contact: configured
        levels (n,) [Nm]."""
        self._tick, self._joints, self._limits = tick, tick.drives.names, limits
        self._period_s = period_s
        self._settled, self._contact = tuple(settled), contact

    def unsettled(self) -> list[str]:
        """Reasons why the identified values cannot be trusted in this run; empty if they can."""
        return [check.text for check in self._settled if not check.passed]

    def run(self, time_s: float) -> ArmingResult:
        """Result at `time_s`, from the last tick and the present state of the drives."""
        tick = self._tick
        mode = tick.controller.machine.mode
        return self.judge(tick.last, mode, tick.drives.objections(), time_s)

    def judge(
        self, record: TickRecord | None, mode: Mode, objections: Sequence[Objection], time_s: float
    ) -> ArmingResult:
        """Result in `mode` at `time_s`, from the record of the last tick and the objections of the
        drives.

        A record that is older than a period fails `loop`: the arm is never armed on an outdated
        state. If a joint's samples are not of that tick, no check of `SAMPLED` passes.
        """
        if record is None or record.estimate is None:
            text = "no samples of the drives yet"
            return ArmingResult((_failed("mode", text),), (text,))
        failures = [
            *([] if mode in ARMABLE else [_failed("mode", refusal(mode, "arm"))]),
            *([_failed("faults", refusal(mode, "arm"))] if mode is Mode.FAULTED else []),
            *self._of_findings(record.findings),
            *(_failed(objection.check, objection.text) for objection in objections),
            *(check for check in self._settled if not check.passed),
            *self._of_estimate(record.estimate, record.samples, record.time_s),
            *self._of_sensing(record),
            *self._of_limits(record.samples),
            *self._of_loop(record.time_s, time_s),
        ]
        failures += self._stale_failures(record.samples, {failure.name for failure in failures})
        reasons: dict[str, list[str]] = {}
        for failure in failures:
            reasons.setdefault(failure.name, []).append(failure.text)
        evidence = self._evidence(record.samples, record.estimate) | {"mode": mode.value}
        checks = tuple(
            _failed(name, "; ".join(reasons[name]))
            if name in reasons
            else Check(name=name, passed=True, text=evidence.get(name, "nothing found"))
            for name in ("mode", *NAMES)
        )
        return ArmingResult(checks, tuple(dict.fromkeys(f.text for f in failures)))

    def _stale_failures(self, samples: Samples, failed: set[str]) -> list[Check]:
        """Failures of checks that would otherwise pass on samples from before this tick."""
        old = ", ".join(self._joints[i] for i in np.flatnonzero(~samples.fresh).tolist())
        text = f"unknown: no samples of {old} in this tick"
        return [_failed(n, text) for n in NAMES if n in SAMPLED - failed] if old else []

    def _of_findings(self, findings: Sequence[Finding]) -> Iterator[Check]:
        for finding in findings:
            if finding.condition is not Condition.LATE:  # late ticks are counted instead
                yield _failed(finding.check, str(finding))

    def _of_estimate(self, estimate: Estimate, samples: Samples, time_s: float) -> Iterator[Check]:
        if doubts := estimate.flags & ~HARMLESS:
            words = ", ".join(FLAG_NAMES[flag] for flag in doubts)
            yield _failed("estimator", f"the estimator is not ready: {words}")
        for i in np.flatnonzero(estimate.threshold > RAISED * self._contact).tolist():
            yield _failed(
                "thresholds",
                f"{self._joints[i]} detects nothing below {estimate.threshold[i]:.2f} Nm now, more "
                f"than {RAISED:g} times its contact level of {self._contact[i]:.2f} Nm: friction "
                "at rest or its speed may hide that much (`contactd identify friction`, then "
                "thresholds; if it only rests, `contactctl start` first; if this remains, set its "
                "`thresholds.contact` to at least "
                f"{np.ceil(100.0 * estimate.threshold[i] / RAISED) / 100.0:.2f} Nm)",
            )
        for i in np.flatnonzero(estimate.thresholded == 0.0).tolist():
            if (for_s := time_s - self._tick.recent.touched_s[i]) < SENSES_S:
                text = f"{self._joints[i]} has been below its threshold for only {for_s:.2f} s"
                needed = f"at least {SENSES_S:g} s required: let go, and ask again"
                yield _failed("residual", f"residual of {text}, {needed}")
        for i in np.flatnonzero(estimate.thresholded).tolist():
            on = samples.drives[i].condition is DriveCondition.OPERATING
            cause = "a touch, or a payload?" if on else "a brake that carries it, or a touch?"
            yield _failed(
                "residual",
                f"residual of {self._joints[i]} is {estimate.residual[i]:+.2f} Nm, above its "
                f"threshold of {estimate.threshold[i]:.2f} Nm: {cause}",
            )

    def _of_sensing(self, record: TickRecord) -> Iterator[Check]:
        lately: list[str] = []
        shortest_s = SENSES_S
        for name, senses, since_s in zip(
            self._joints, record.sensing.tolist(), record.sensing_since_s.tolist(), strict=True
        ):
            if not senses:
                yield _failed("estimator", f"{name} does not sense contact")
            elif (for_s := record.time_s - since_s) < SENSES_S:
                lately.append(name)
                shortest_s = min(shortest_s, for_s)
        if lately:
            yield _failed(
                "estimator",
                f"sensing contact for only {shortest_s:.2f} s, at least {SENSES_S:g} s required: "
                f"{', '.join(lately)}; ask again (if it comes and goes, `contactctl status` shows "
                "which samples are lost)",
            )

    def _of_limits(self, samples: Samples) -> Iterator[Check]:
        q, limits = samples.link_position, self._limits
        for i in np.flatnonzero(limits.outside(q)).tolist():
            yield _failed(
                "limits",
                f"{self._joints[i]} stands at {q[i]:.3f} rad, more than {limits.tolerance:g} "
                f"outside its limits [{limits.lower[i]:g}, {limits.upper[i]:g}]",
            )

    def _of_loop(self, ticked_s: float, time_s: float) -> Iterator[Check]:
        late = self._tick.recent.late_s
        if len(late) > LATE_TICKS and (ago_s := ticked_s - late[0]) < LATE_WITHIN_S:
            yield _failed("loop", f"{len(late)} ticks were late in the last {ago_s:.1f} s")
        if (age_s := time_s - ticked_s) > OLDEST * self._period_s:
            yield _failed("loop", f"the last tick is {1000 * age_s:.0f} ms old: ask again")

    def _evidence(self, samples: Samples, estimate: Estimate) -> dict[str, str]:
        """Evidence for each check that passes, by name."""
        n = len(self._joints)
        on = [drive.condition for drive in samples.drives].count(DriveCondition.OPERATING)
        i = int(np.argmax(np.abs(estimate.residual) / estimate.threshold))
        k = int(np.argmax(estimate.threshold / self._contact))
        return {
            "drives": f"{on} of {n} in operation, none in fault",
            "samples": "all fresh in this tick",
            "heartbeats": f"received from {n} drives, none misses ours",
            "emergencies": "none",
            "set-up": "written to the drives and read back",
            **{check.name: check.text for check in self._settled},
            "estimator": "ready",
            "residual": f"at most {estimate.residual[i]:+.2f} of {estimate.threshold[i]:.2f} Nm "
            f"({self._joints[i]})",
            "thresholds": f"at most {estimate.threshold[k] / self._contact[k]:.1f} times what is "
            f"configured: {estimate.threshold[k]:.2f} of {self._contact[k]:.2f} Nm "
            f"({self._joints[k]})",
            "limits": "every joint inside",
            "loop": f"at most {LATE_TICKS} late ticks in {LATE_WITHIN_S:g} s",
        }


def _failed(name: str, text: str) -> Check:
    return Check(name=name, passed=False, text=text)
