"""One tick: SYNC, samples, estimate, decision, setpoints; and what is published of it.

`begin` and `finish` are apart so that a test in lockstep can let the simulated drives answer the
SYNC in between. Times come from the caller.
"""

import time
from dataclasses import dataclass

import numpy as np

from daemon.faults.detector import FaultDetector
from daemon.faults.finding import Finding
from daemon.faults.table import Response
from daemon.modes.table import SENSING, Mode
from daemon.motion.limits import all_finite
from daemon.protocol.messages import Check, Contact, Notice, PerJoint, SideName, State, Timing
from daemon.tick.arming_checks import FLAG_NAMES, Objection, PreArm
from daemon.tick.controller import ControlInput, Controller, Decision
from drivers.answers import Samples
from drivers.cia402 import DriveState, PowerTarget
from drivers.drives import Drives
from estimator.estimate import Estimate, Flag
from estimator.estimator import Estimator
from estimator.motor_position import Side

SIDE_NAMES: dict[int, SideName] = {
    Side.LEFT: "left",
    Side.GAP: "gap",
    Side.RIGHT: "right",
    Side.UNKNOWN: "unknown",
}
DRIVE_STATE_NAMES = {state: state.name.lower().replace("_", " ") for state in DriveState}


@dataclass(frozen=True, slots=True)
class Wakeup:
    """How the loop met the deadline of a tick."""

    monotonic_s: float = 0.0
    lateness_s: float = 0.0
    work_s: float = 0.0  # of the tick before
    missed: int = 0  # deadlines, since the start
    left_out: int = 0  # deadlines that this tick came too late for
    doors_s: float = 0.0  # what clients and the log took, after the tick before


ON_TIME = Wakeup()
# Setpoints are never moved on by more than this at once, however late a tick comes [periods].
LONGEST_STEP = 2.0


class Tick:
    """Everything of one arm that a tick touches."""

    def __init__(
        self,
        drives: Drives,
        estimator: Estimator,
        controller: Controller,
        observer: FaultDetector,
        prearm: PreArm,
        period_s: float,
    ) -> None:
        self.drives, self.estimator, self.controller = drives, estimator, controller
        self.number = -1
        self.notices: list[Notice] = []
        self.prearm = prearm
        self._observer = observer
        self._period_s = period_s
        self._time_s = 0.0
        self._sampled_s = -period_s  # time of the last complete samples
        self._decided_s = -period_s  # time of the last decision
        self._interval_s = period_s
        self._updated = False
        self._finite = True  # estimate and reference
        self._findings: tuple[Finding, ...] = ()
        self._samples: Samples | None = None
        self._estimate: Estimate | None = None
        self._decision: Decision | None = None
        self._told: frozenset[Finding] = frozenset()
        self._nothing = np.zeros(len(drives.names))
        self.fatal: Finding | None = None
        """What the program must end for, once the drives are told to stop."""

    @property
    def samples(self) -> Samples | None:
        """Of the last tick."""
        return self._samples

    @property
    def estimate(self) -> Estimate | None:
        """The last one that was made."""
        return self._estimate

    @property
    def decision(self) -> Decision | None:
        """The last one."""
        return self._decision

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Of the last tick."""
        return self._findings

    def begin(self, time_s: float) -> None:
        """Send SYNC: the drives sample now."""
        self._time_s = time_s
        self.number += 1
        self.notices.clear()
        self.drives.sync(time_s)

    def finish(self, deadline: float, wakeup: Wakeup = ON_TIME) -> None:
        """Take the samples that arrive until `deadline` (the arm's clock), decide, command."""
        samples = self._samples = self.drives.collect(deadline)
        estimate = self._estimated(samples)
        machine = self.controller.machine
        mode = machine.mode
        findings = self._findings = self._observer.findings(
            samples,
            mode,
            lateness_s=wakeup.lateness_s,
            left_out=wakeup.left_out,
            setpoint=None if self._decision is None else self._decision.velocity,
            residual=estimate.residual if estimate and self._updated and self._finite else None,
            interval_s=self._interval_s,
            finite=self._finite,
        )
        self.prearm.watch(samples, findings, self._time_s)
        fatal = (f for f in findings if f.response is Response.FAULT_EXIT)
        self.fatal = self.fatal or (next(fatal, None) if findings else None)
        if estimate is None:
            self.controller.doubt(self._time_s, findings)
            if self.controller.faulted:
                self.drives.command(PowerTarget.QUICK_STOP, self._nothing)
        else:
            observed = self._observe(samples, estimate, findings)
            decision = self.controller.step(self._time_s, self._step_s(), observed)
            self._decision = decision
            self.drives.command(decision.power, decision.velocity, decision.reset)
        if mode is Mode.ENABLING and machine.mode is Mode.HOLDING:
            # What friction held until now is not an external torque.
            self.estimator.reset()
        self._tell(findings, mode)

    def _step_s(self) -> float:
        """Time since the last decision, for which its setpoints have been in force [s]."""
        step = self._time_s - self._decided_s
        self._decided_s = self._time_s
        return min(step, LONGEST_STEP * self._period_s)

    def _estimated(self, samples: Samples) -> Estimate | None:
        """The estimate from these samples; the one before where they are not complete."""
        self._updated, self._finite = all(samples.fresh.tolist()), True
        if self._updated:
            self._interval_s = self._time_s - self._sampled_s
            self._sampled_s = self._time_s
            self._estimate = self.estimator.step(
                samples.current,
                samples.link_position,
                samples.motor_velocity,
                samples.motor_position,
                self._interval_s,
                time_s=self._time_s,
            )
        if self._estimate is not None and Flag.INVALID in self._estimate.flags:
            self._finite = False
        if self._decision is not None and not all_finite(self._decision.reference):
            self._finite = False
        return self._estimate

    def _observe(
        self, samples: Samples, estimate: Estimate, findings: tuple[Finding, ...]
    ) -> ControlInput:
        touched = hit = ""
        # A touch counts as long as it lasts: one that began while the arm was stopping still
        # makes it yield. A blow counts once.
        if np.count_nonzero(estimate.thresholded):
            joints = self.estimator.detector.touched().tolist()
            if any(joints):
                i = joints.index(True)
                touched = f"{self.drives.names[i]} feels {estimate.residual[i]:+.2f} Nm"
        for contact in estimate.contacts if self._updated else ():
            if contact.level == "collision":
                hit = f"{contact.joint} feels {contact.torque:+.2f} Nm, beyond its collision level"
        return ControlInput(
            q=samples.link_position,
            motor_velocity=samples.motor_velocity,
            thresholded=estimate.thresholded,
            touched=touched,
            hit=hit,
            operating=tuple(state is DriveState.OPERATION_ENABLED for state in samples.states),
            findings=findings,
            objections=self._objections,
            age_s=None if self._updated else np.multiply(samples.age_ticks, self._period_s),
            play=self.estimator.transmission.play(estimate.phi, estimate.phi_sigma),
        )

    # --- what others see of it --------------------------------------------------------------

    def _objections(self) -> tuple[Objection, ...]:
        """Why nobody should arm now, after the last tick. Not asked in a tick."""
        samples, estimate = self._samples, self._estimate
        if samples is None or estimate is None:
            return ()
        silent, restarted = self.drives.silent(), self.drives.restarted()
        return self.prearm.objections(samples, estimate, self._findings, silent, restarted)

    def checks(self) -> list[Check]:
        """What arming needs, each passed or failed: the mode, and everything else by name."""
        reason = self.controller.mode_refusal()
        text = reason or self.controller.machine.mode.value
        checks = [Check(name="mode", passed=not reason, text=text)]
        if self._samples is not None and self._estimate is not None:
            objections = self.controller.objections
            checks += self.prearm.checks(objections, self._samples, self._estimate)
        return checks

    def _tell(self, findings: tuple[Finding, ...], mode: Mode) -> None:
        """Put this tick's news into `notices`; a finding is told once until the latch is reset, and
        a contact where the arm feels in `mode`: elsewhere it may be a brake that carries it."""
        if findings or self._told:
            for finding in findings:
                if finding.response > Response.CONTINUE and finding not in self._told:
                    self.notices.append(Notice(kind="fault", text=str(finding)))
            latched = self._told if self.controller.faulted else frozenset()
            self._told = latched.union(findings)
        changes = self.controller.machine.changes
        for change in changes:
            self.notices.append(Notice(kind="mode", text=f"{change.text}: {change.cause}"))
        changes.clear()
        if self._updated and self._estimate is not None and mode in SENSING:
            for c in self._estimate.contacts:
                contact = Contact(
                    joint=c.joint,
                    torque=c.torque,
                    threshold=c.threshold,
                    level=c.level,
                    side=SIDE_NAMES[c.side],
                )
                text = f"{c.joint} {c.torque:+.2f} Nm ({c.level})"
                self.notices.append(Notice(kind="contact", text=text, contact=contact))

    def state(self, wakeup: Wakeup = ON_TIME) -> State:
        """This tick, for the readers. Raises RuntimeError before the first complete samples."""
        samples, estimate, decision = self._samples, self._estimate, self._decision
        if samples is None or estimate is None or decision is None:
            raise RuntimeError("no complete samples yet")
        machine = self.controller.machine
        motor_position = samples.motor_position
        return State(
            tick=self.number,
            time_s=self._time_s,
            interval_s=self._interval_s,
            mode=machine.mode,
            armed=machine.armed,
            cause=machine.cause,
            moving=machine.moving,
            fresh=samples.fresh.tolist(),
            drives=[DRIVE_STATE_NAMES[state] for state in samples.states],
            current=finite_list(samples.current),
            link_position=finite_list(samples.link_position),
            motor_velocity=finite_list(samples.motor_velocity),
            motor_position=None if motor_position is None else finite_list(motor_position),
            link_velocity=estimate.q_dot.tolist(),
            motor_estimate=estimate.theta.tolist(),
            phi=estimate.phi.tolist(),
            phi_sigma=estimate.phi_sigma.tolist(),
            side=[SIDE_NAMES[side] for side in estimate.side.tolist()],
            motor_torque=estimate.tau_M.tolist(),
            residual=estimate.residual.tolist(),
            threshold=estimate.threshold.tolist(),
            thresholded=estimate.thresholded.tolist(),
            touched_link=estimate.touched_link,
            beside={name: values.tolist() for name, values in estimate.beside.items()},
            flags=[FLAG_NAMES[flag] for flag in estimate.flags],
            updated=self._updated,
            reference=finite_list(decision.reference),
            setpoint=decision.velocity.tolist(),
            quiet_s=self.controller.quiet_s,
            notices=list(self.notices),
            timing=Timing(
                wall_s=time.time(),
                monotonic_s=wakeup.monotonic_s,
                lateness_us=wakeup.lateness_s * 1e6,
                work_us=wakeup.work_s * 1e6,
                doors_us=wakeup.doors_s * 1e6,
                missed=wakeup.missed,
            ),
        )


def finite_list(values: np.ndarray) -> PerJoint:
    """As a list; JSON has no NaN, and msgspec would write null where a number is promised."""
    return [value if value == value else 0.0 for value in values.tolist()]  # noqa: PLR0124
