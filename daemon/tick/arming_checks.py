"""What must be right before the arm may yield to hands: named checks, each passed or failed.

A tick only takes note of what will be forgotten (`watch`); `objections` and `checks` are for those
who ask between two ticks. No I/O; time is an argument.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon.faults.finding import Finding
from daemon.faults.table import Condition
from daemon.motion.limits import Limits
from daemon.protocol.messages import Check
from drivers.answers import Samples
from drivers.cia402 import FAULT_STATES, DriveState
from drivers.events import Emergency, Rebooted, described
from estimator.estimate import Estimate, Flag

#: In the order in which they are shown, after the mode.
NAMES = (
    "drives",
    "samples",
    "heartbeats",
    "emergencies",
    "set-up",
    "identification",
    "estimator",
    "residual",
    "limits",
    "loop",
    "faults",
)

# A busy machine is late now and then, and one tick is made up for; a loop that is not on time is
# late more than so often in so many seconds.
LATE_TICKS, LATE_WITHIN_S = 2, 1.0
# EMCY: the drive misses the master's heartbeat (CiA 301).
MASTER_SILENT = 0x8130
FLAG_NAMES = {flag: flag.name.lower() for flag in Flag if flag.name}


@dataclass(frozen=True, slots=True)
class Objection:
    """Why a check fails."""

    check: str
    reason: str

    def __str__(self) -> str:
        return self.reason


@dataclass(frozen=True, slots=True)
class Verdict:
    """What was found once, at start, of a check that does not change while the daemon runs."""

    passed: bool
    text: str


class PreArm:
    """Remembers what a single tick does not show: emergencies, late ticks.

    `identification` is the verdict on identified values: do they belong to these drives, and did
    they pass? Whoever reads them sets it before the first tick.
    """

    def __init__(self, joints: Sequence[str], nodes: Sequence[int], limits: Limits) -> None:
        self.identification = Verdict(True, "none; the values of config.yaml are trusted")
        self._joints, self._limits = tuple(joints), limits
        self._index = {node: i for i, node in enumerate(nodes)}
        self._joint_of = dict(zip(nodes, self._joints, strict=True))
        self._emergencies: dict[int, Emergency] = {}
        self._in_fault: set[int] = set()
        self._late_s: deque[float] = deque(maxlen=LATE_TICKS + 1)
        self._time_s = 0.0

    def watch(self, samples: Samples, findings: Sequence[Finding], time_s: float) -> None:
        """Take note of one tick."""
        self._time_s = time_s
        for event in samples.events:
            if isinstance(event, Rebooted) or (isinstance(event, Emergency) and event.code == 0):
                self._over(event.node)
            elif isinstance(event, Emergency):
                self._emergencies[event.node] = event
        # A drive that leaves its fault has no emergency any more, whether it says so or not.
        for node in tuple(self._emergencies):
            faulted = node in self._index and samples.states[self._index[node]] in FAULT_STATES
            if faulted:
                self._in_fault.add(node)
            elif node in self._in_fault:
                self._over(node)
        if any(finding.check == "loop" for finding in findings):
            self._late_s.append(time_s)

    def renewed(self, joints: Sequence[int]) -> None:
        """These drives were set up again, and what they had said before is over: without ticks
        nobody heard them say so."""
        for node, joint in self._index.items():
            if joint in joints:
                self._over(node)

    def _over(self, node: int) -> None:
        self._emergencies.pop(node, None)
        self._in_fault.discard(node)

    def objections(
        self,
        samples: Samples,
        estimate: Estimate,
        findings: Sequence[Finding],
        silent: Sequence[str],
        restarted: Sequence[str],
    ) -> tuple[Objection, ...]:
        """Every reason against arming now; `unheard` names the drives whose heartbeat is missing,
        `forgetful` those that restarted and were not set up again."""
        found = [
            Objection(f.check, str(f))
            for f in findings
            if f.condition is not Condition.LATE  # which is counted
        ]
        if silent:
            found.append(Objection("heartbeats", f"not heard from {', '.join(silent)}"))
        for emergency in self._emergencies.values():
            check = "heartbeats" if emergency.code == MASTER_SILENT else "emergencies"
            words = described(emergency, self._joint_of)
            found.append(Objection(check, f"emergency of {words}, and not over"))
        if restarted:
            reason = f"restarted, and without their set-up: {', '.join(restarted)}"
            found.append(Objection("set-up", f"{reason} (`contactctl reset`)"))
        if not self.identification.passed:
            found.append(Objection("identification", self.identification.text))
        if estimate.flags:
            words = ", ".join(FLAG_NAMES[flag] for flag in estimate.flags)
            found.append(Objection("estimator", f"the estimator is not ready: {words}"))
        if estimate.thresholded.any():
            found += [
                Objection(
                    "residual",
                    f"{name} feels {estimate.residual[i]:+.2f} Nm, beyond its threshold of "
                    f"{estimate.threshold[i]:.2f} Nm: is somebody touching it?",
                )
                for i, name in enumerate(self._joints)
                if estimate.thresholded[i]
            ]
        outside = self._limits.outside(samples.link_position)
        if outside.any():
            found += [
                Objection(
                    "limits",
                    f"{name} stands at {samples.link_position[i]:.3f} rad, more than "
                    f"{self._limits.tolerance:g} outside its limits "
                    f"[{self._limits.lower[i]:g}, {self._limits.upper[i]:g}]",
                )
                for i, name in enumerate(self._joints)
                if outside[i]
            ]
        late = self._late_s
        if len(late) > LATE_TICKS and (ago_s := self._time_s - late[0]) < LATE_WITHIN_S:
            found.append(
                Objection("loop", f"{len(late)} ticks were late in the last {ago_s:.1f} s")
            )
        return tuple(found)

    def checks(
        self, objections: Sequence[Objection], samples: Samples, estimate: Estimate
    ) -> list[Check]:
        """Every check by name, with its reasons or with what speaks for it."""
        reasons: dict[str, list[str]] = {}
        for objection in objections:
            reasons.setdefault(objection.check, []).append(objection.reason)
        return [
            Check(
                name=name,
                passed=name not in reasons,
                text="; ".join(reasons[name])
                if name in reasons
                else self._evidence(name, samples, estimate),
            )
            for name in NAMES
        ]

    def _evidence(self, name: str, samples: Samples, estimate: Estimate) -> str:
        """What speaks for a check that passes."""
        n = len(self._joints)
        on = samples.states.count(DriveState.OPERATION_ENABLED)
        i = int(np.argmax(np.abs(estimate.residual) / estimate.threshold))
        words = {
            "drives": f"{on} of {n} in operation, none in fault",
            "samples": "all fresh in this tick",
            "heartbeats": f"heard from {n} drives, none misses ours",
            "emergencies": "none",
            "set-up": "written to the drives and read back",
            "identification": self.identification.text,
            "estimator": "ready",
            "residual": f"at most {estimate.residual[i]:+.2f} of {estimate.threshold[i]:.2f} Nm "
            f"({self._joints[i]})",
            "limits": "every joint inside",
            "loop": f"at most {LATE_TICKS} late ticks in {LATE_WITHIN_S:g} s",
        }
        return words.get(name, "nothing found")
