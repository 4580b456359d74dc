"""One tick: read, estimate, detect faults, decide, command; and its record.

`begin` and `finish` are separate so that simulated drives can answer the SYNC in between, in tests
that run in lockstep. Times come from the caller.
"""

import numpy as np
from msgspec import UNSET

from common.arrays import Vector
from daemon.faults.conditions import Response
from daemon.faults.detector import FaultDetector
from daemon.faults.finding import Finding
from daemon.modes.machine import Change
from daemon.modes.table import ENERGISED, GUIDED, SENSING, YIELDING, Mode, refusal
from daemon.motion.hand_witness import IndependentResidual, agreed
from daemon.motion.limits import all_finite
from daemon.tick.controller import Controller
from daemon.tick.decision import ControlInput, Decision
from daemon.tick.learning_notices import LearningNotices
from daemon.tick.load_watch import LoadWatch
from daemon.tick.notices import Notices
from daemon.tick.recent import RecentEvents
from daemon.tick.sample_losses import SampleLosses
from daemon.tick.sensing import Sensing
from daemon.tick.telemetry import ON_TIME, TickRecord, Wakeup, near_of
from drivers.api import Drives, PowerTarget, Samples
from estimator.estimate import Estimate, Flag
from estimator.estimator import Estimator
from estimator.payload import Payload
from estimator.walls import Walls

# A sample younger than this still shows whether a joint is at standstill [periods].
RECENT_PERIODS = 2.5
# Setpoints never advance by more than this in one tick, however late it is [periods].
LONGEST_STEP = 2.0


class Tick:
    """All parts of one arm that a tick uses; `last` is the record of the last one."""

    def __init__(
        self,
        drives: Drives,
        estimator: Estimator,
        controller: Controller,
        detector: FaultDetector,
        period_s: float,
    ) -> None:
        self.drives, self.estimator, self.controller = drives, estimator, controller
        self.number = -1
        self.last: TickRecord | None = None
        """None before the first tick"""
        self.fatal: Finding | None = None
        """Finding that ends the program, once the drives are commanded to stop"""
        self._detector = detector
        self._period_s = period_s
        self._time_s = 0.0
        self._sampled_s = np.full(len(drives.names), -period_s)  # time of the last samples
        self._gaps = np.zeros(len(drives.names))
        self._was_complete = False  # the previous samples
        self._sensing = Sensing(len(drives.names), estimator.settings.gain)
        self.recent = RecentEvents(len(drives.names))
        self._notices = Notices(drives.names, controller.machine)
        self.losses = SampleLosses(drives.names, period_s)
        self._standstill = np.zeros(len(drives.names))
        self.payload: Payload | None = None
        """Payload at the hand in the model, from the next tick on"""
        self.loads = LoadWatch(estimator)
        self.learning_notices = LearningNotices(estimator, drives.names)

    def begin(self, time_s: float) -> None:
        """Send SYNC: the drives sample now."""
        self._time_s = time_s
        self.number += 1
        self.drives.sync(time_s)

    def finish(self, deadline: float, wakeup: Wakeup = ON_TIME) -> None:
        """Collect the samples that arrive until `deadline` (the drives' clock), decide, command."""
        before, time_s, machine = self.last, self._time_s, self.controller.machine
        recognised = self.loads.found
        samples, mode = self.drives.collect(deadline), machine.mode
        complete = all(samples.fresh.tolist())
        interval_s = time_s - before.time_s if before else self._period_s
        estimate = self._estimated(samples, interval_s)
        self._sensing.step(time_s, estimate)
        gaps = self._gaps_of(samples, interval_s, complete=complete)
        command = before.decision if before else None
        finite = _finite(estimate, command)
        findings = self._detector.findings(
            samples,
            mode,
            lateness_s=wakeup.lateness_s,
            left_out=wakeup.left_out,
            setpoint=command.velocity if command else None,
            residual=estimate.residual if estimate and finite else None,
            gaps=gaps,
            finite=finite,
            sensing=self._sensing.joints,
            settled=self._sensing.settled,
        )
        self.recent.step(findings, estimate, time_s)
        self.fatal = self.fatal or _fatal(findings)
        decision = self._decided(samples, estimate, findings, complete=complete)
        if mode is Mode.ENABLING and machine.mode is Mode.HOLDING:
            # The torque that friction held until now is not an external torque.
            self.estimator.reset()
            self._sensing.begin_anew(time_s)
        if not machine.moving:  # contacts at rest interrupt no trajectory
            self.estimator.interrupted[:] = 0
        # No contact is sensed while a brake may carry the arm.
        contacts = estimate.contacts if estimate is not None and mode in SENSING else ()
        loads = self.loads.step(machine.mode, estimate, self._sensing)
        losses = self.losses.step(samples.arrived, complete=complete)
        news, senses = self.learning_notices, mode in SENSING
        learned = news.step(time_s, led=mode in YIELDING) if senses else ()
        others = (*losses, *loads, *learned)
        self.last = TickRecord(
            number=self.number,
            time_s=time_s,
            wakeup=wakeup,
            samples=samples,
            interval_s=interval_s,
            estimate=estimate,
            sensing=self._sensing.joints,
            sensing_since_s=self._sensing.since_s,
            findings=findings,
            decision=decision,
            mode=machine.mode,
            armed=machine.armed,
            cause=machine.cause,
            moving=machine.moving,
            quiet_s=self.controller.quiet.quiet_s,
            unproved=(unproved := self.drives.unproved()),
            payload=self.payload,
            recognised=recognised,
            silenced=self.drives.silenced,
            stream=self.controller.stream_state(),
            near=near_of(self.controller.motion.walls) if machine.mode in SENSING else UNSET,
            meeting=self.controller.motion.meeting or UNSET,
            guide=self.controller.motion.guidance.words or UNSET,
            notices=self._notices.step(time_s, self._sensing, findings, contacts, unproved, others),
        )

    def _gaps_of(self, samples: Samples, interval_s: float, *, complete: bool) -> Vector:
        """Time between the previous and the present sample of each joint (n,) [s], 0 where none
        came; the array is overwritten in the next tick."""
        gaps, time_s = self._gaps, self._time_s
        if complete and self._was_complete:
            gaps.fill(interval_s)
        else:
            gaps[:] = samples.fresh * (time_s - self._sampled_s)
        if complete:
            self._sampled_s.fill(time_s)
        else:
            self._sampled_s[samples.fresh] = time_s
        self._was_complete = complete
        return gaps

    def _estimated(self, samples: Samples, interval_s: float) -> Estimate | None:
        """Estimate of this tick; None until every joint has sent a sample."""
        begun = self.last is not None and self.last.estimate is not None
        if not begun and np.isnan(samples.link_position + samples.motor_velocity).any():
            return None
        return self.estimator.step(
            samples.current,
            samples.link_position,
            samples.motor_velocity,
            samples.motor_position,
            interval_s,
            time_s=self._time_s,
            fresh=samples.fresh,
        )

    def _decided(
        self,
        samples: Samples,
        estimate: Estimate | None,
        findings: tuple[Finding, ...],
        *,
        complete: bool,
    ) -> Decision | None:
        """Decide and command the drives; without an estimate only stop them."""
        if estimate is None:
            self.controller.doubt(self._time_s, findings)
            if self.controller.faulted:
                self.drives.command(PowerTarget.QUICK_STOP, self._standstill)
            return None
        known = self._control_input(samples, estimate, findings, complete=complete)
        decision = self.controller.step(self._time_s, self._step_s(), known)
        machine = self.controller.machine
        # Slow requests could delay a stop, or a maker's tool: none are made unless the arm rests.
        at_rest = machine.mode is Mode.HOLDING and not machine.armed
        self.drives.command(decision.power, decision.velocity, decision.reset, ask=at_rest)
        return decision

    def _step_s(self) -> float:
        """Time since the last decision, for which its setpoints have been in force [s]."""
        before = self.last
        decided_s = before.time_s if before and before.decision else -self._period_s
        return min(self._time_s - decided_s, LONGEST_STEP * self._period_s)

    def _control_input(
        self, samples: Samples, estimate: Estimate, findings: tuple[Finding, ...], *, complete: bool
    ) -> ControlInput:
        touched = hit = load = ""
        # Both count as long as they last: a contact that began while the arm was stopping still
        # makes it yield, and a collision is not over because the arm stands.
        if any(estimate.thresholded.tolist()) and not self.loads.settles(estimate):
            detector, names = self.estimator.detector, self.drives.names
            residual = estimate.residual
            if any(joints := detector.touched().tolist()):
                i = joints.index(True)
                touched = f"contact of {residual[i]:+.2f} Nm at {names[i]}"
                load = self.loads.explains(estimate)
            if any(joints := detector.hit().tolist()):
                i = joints.index(True)
                hit = (
                    f"contact of {residual[i]:+.2f} Nm at {names[i]}, above its collision level of "
                    f"{detector.levels.collision[i]:.2f} Nm"
                )
        return ControlInput(
            q=samples.link_position,
            motor_velocity=samples.motor_velocity,
            residual=estimate.residual,
            thresholded=estimate.thresholded,
            touched=touched,
            hit=hit,
            load=load,
            struck=any(one.level == "collision" for one in estimate.contacts),
            sure=self._sensing.sure,
            too_often=self.learning_notices.too_often,
            drives=samples.drives,
            findings=findings,
            recent=complete or bool((samples.age_s < RECENT_PERIODS * self._period_s).all()),
            age_s=None if complete else samples.age_s,
            independent=IndependentResidual(
                agreed(estimate.residual, estimate.uncorrected),
                estimate.threshold,
                estimate.threshold + (1.0 - estimate.level_share) * self.estimator.contact,
                self.estimator.contact,
            ),
            play=self.estimator.transmission.play(estimate.phi, estimate.phi_sigma),
        )

    # --- requests between two ticks ---------------------------------------------------------

    def carry(self, payload: Payload | None, who: str, walls: Walls | None = None) -> list[str]:
        """Set the payload of the model, None for none, and the walls with its shape, from the next
        tick on; returns the reasons for a refusal."""
        machine = self.controller.machine
        if machine.mode in GUIDED or machine.mode in YIELDING:
            why = refusal(machine.mode, "payload")
            return [f"{why}: let go of it first; if only a load moves it, `contactctl stop`"]
        text = f"payload {payload}" if payload else "payload none"
        motion = self.controller.motion
        if motion.walls is not None:
            motion.walls = walls or motion.walls
            text += ", whose shape is not guarded" if payload and not payload.box else ""
        self.estimator.carry(payload)
        self.payload = payload
        self.loads.announce(payload)
        machine.changes.append(Change(text, f"by {who}"))
        return []

    def unproved(self) -> tuple[str, ...]:
        """Joints that must stand and are not confirmed at standstill: all joints, until the next
        tick commands them to stop."""
        to_stand = self.controller.machine.mode not in ENERGISED
        if to_stand and self.last is not None and self.last.mode in ENERGISED:
            return self.drives.names
        return self.drives.unproved()


def _finite(estimate: Estimate | None, decision: Decision | None) -> bool:
    """True if estimate and reference are finite, or absent."""
    if estimate is not None and estimate.flags and Flag.INVALID in estimate.flags:
        return False
    return decision is None or all_finite(decision.reference)


def _fatal(findings: tuple[Finding, ...]) -> Finding | None:
    for finding in findings:
        if finding.response is Response.FAULT_EXIT:
            return finding
    return None
