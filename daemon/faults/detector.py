"""Fault detector: from the samples and the estimate of one tick to its findings. No I/O."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.arrays import Vector
from daemon.faults.conditions import Condition
from daemon.faults.finding import Finding
from daemon.faults.following import Following
from daemon.faults.ignored_setpoints import IgnoredSetpoints
from daemon.faults.plausibility import Plausibility
from daemon.faults.supply import Supply
from daemon.faults.table import TABLE
from daemon.modes.table import SENSING, Mode
from drivers.api import DriveCondition, DriveStatus, Event, Kind, Samples

CONDITION_OF = {row.source: condition for condition, row in TABLE.items() if row.source}
# Conditions that a loaded bus may cause; the load is then reported with them.
OF_LOAD = frozenset(
    {
        Condition.SAMPLE_MISSING,
        Condition.STALE,
        Condition.UNHEARD,
        Condition.HEARTBEAT_LOST,
        Condition.BUS_DISTURBED,
        Condition.BUS_TROUBLE,
        Condition.ABSENT,
    }
)
# While ticks are late, stale samples are tolerated for this many times `stale_ticks`; a drive whose
# samples are missing in most ticks counts as stale after as many.
STARVED_FACTOR = 3
# Decrement of a count of bad ticks by a good tick: with one half, a third of bad ticks is
# tolerated. The count of a drive's missing samples, which are bridged, is decremented by one: half
# of the ticks are tolerated.
LEAK = 0.5


# Largest number and duration of ticks with a joint that does not sense, until the arm holds.
NOT_SENSING_TICKS, NOT_SENSING_S = 5, 0.06
# The same for ticks in which all answers are late. Lateness is relative to a median, which is
# meaningless if late and prompt answers are equally frequent.
LATE_TICKS = 100


def tolerated_ticks(period_s: float) -> int:
    """Ticks for which an arm with this period may continue with a joint that does not sense, at
    least one. A joint counts as such only after `SENSED_PERIODS`."""
    return min(max(int(NOT_SENSING_S / period_s + 1e-9), 1), NOT_SENSING_TICKS)


@dataclass(frozen=True, slots=True)
class DetectorSettings:
    """Ticks for which a disturbance is tolerated before it becomes a fault, and their period."""

    period_s: float
    stale_ticks: int
    overrun_ticks: int
    # Ticks with a joint that does not sense, less half of the other ticks, until the arm holds.
    not_sensing_ticks: int = NOT_SENSING_TICKS


class FaultDetector:
    """Detector of the conditions that hold. Counts disturbances that become faults only later."""

    def __init__(
        self,
        joints: Sequence[str],
        settings: DetectorSettings,
        plausibility: Plausibility,
        following: Following,
        ignored: IgnoredSetpoints,
    ) -> None:
        """joints: names in the order of the arm."""
        self._names = tuple(joints)
        self._settings = settings
        self._plausibility, self._following = plausibility, following
        self._ignored = ignored
        # Counts of bad ticks, which good ticks decrement:
        self._missed = 0.0  # missed deadlines
        self._not_sensing = 0.0  # ticks in which some joint did not sense
        self._late, self._too_late = 0.0, False  # ticks with late answers; latched until 0
        self._disturbed = 0.0  # ticks with a disturbance
        self._since_late = settings.stale_ticks  # ticks since a late one
        self._missing = np.zeros(len(joints), dtype=np.int64)  # missing samples of each joint
        self._load = ""  # description of the bus load if it is too high
        self._supply = Supply(len(joints))
        self._mode = Mode.OFF
        self._drives: tuple[DriveStatus, ...] = ()  # in the previous tick
        self._operating = False  # all drives

    def findings(
        self,
        samples: Samples,
        mode: Mode,
        *,
        lateness_s: float = 0.0,
        left_out: int = 0,
        setpoint: Vector | None = None,
        residual: Vector | None = None,
        gaps: Vector | None = None,
        finite: bool = True,
        sensing: NDArray[np.bool_] | None = None,
        settled: bool = True,
    ) -> tuple[Finding, ...]:
        """Every condition that holds in this tick; empty in an undisturbed one.

        lateness_s, left_out: lateness of the tick, and the deadlines skipped because of it.
        setpoint: sent to the drives in the previous tick, (n,) [rad/s].
        residual: the estimate's (n,) [Nm], None without one; gaps: time between this sample of each
        joint and its previous one (n,) [s], 0 where none came. finite: True if estimate and
        reference are finite. sensing: joints (n,) that sense contact, by default all; settled: no
        residual is still rising from a restart at zero.
        """
        most = STARVED_FACTOR * self._settings.overrun_ticks
        missed = self._missed + (left_out or -LEAK)
        self._missed = min(max(missed, 0.0), most)
        self._since_late = 0 if left_out else self._since_late + 1
        if self._mode is Mode.FAULTED and mode is not Mode.FAULTED:
            # After a reset, present values are compared with no earlier ones.
            self._plausibility.restart()
            self._ignored.restart()
            self._supply.restart()
            self._missing[:] = 0
            self._not_sensing, self._late, self._too_late = 0.0, 0.0, False
        self._mode = mode
        if mode not in SENSING:
            self._following.restart()
        elif setpoint is not None:
            self._following.record(setpoint)
        found: list[Finding] = []
        # First, as the first of equal findings is the cause: drives report late ticks, too.
        if left_out:
            found += self._of_time(lateness_s)
        self._load = ""
        found += self._of_events(samples.events)
        late = False
        if not all(samples.fresh.tolist()):
            found += self._of_samples(samples)
            late = bool(samples.arrived.any()) and not samples.fresh.any()
        elif any(self._missing.tolist()):
            np.maximum(self._missing - 1, 0, out=self._missing)
        found += self._of_lateness(late=late)
        if sensing is not None:
            found += self._of_sensing(sensing, settled)
        self._supply.step(samples.drives, samples.arrived)
        if samples.drives is not self._drives:
            self._drives = samples.drives
            self._operating = all(map(_operates, samples.drives))
        if not self._operating:
            found += self._of_drives(samples, mode)
        elif self._supply.doubted:
            found += self._of_supply(mode)
        if not finite:
            found.append(Finding(Condition.NOT_FINITE, "in the estimate"))
        if residual is not None and gaps is not None:
            found += self._of_values(samples, mode, residual, gaps)
        return tuple(found)

    def _of_events(self, events: Sequence[Event]) -> Iterator[Finding]:
        # Disturbances may be transient: they become a fault only after some ticks.
        disturbances = [event for event in events if event.kind is Kind.DISTURBED]
        allowed = self._settings.stale_ticks
        if disturbances:
            self._disturbed = min(self._disturbed + 1.0, allowed)
        else:
            self._disturbed = max(self._disturbed - LEAK, 0.0)
        for event in events:
            if event.kind is Kind.LOADED:
                self._load = event.text
                yield Finding(Condition.BUS_LOADED, figures=self._load)
        for event in events:
            # Bus load is shown with other findings.
            if event.kind is not Kind.LOADED and (condition := CONDITION_OF.get(event.kind)):
                yield self._found(condition, event.text)
        if disturbances:
            lasts = self._disturbed >= allowed
            condition = Condition.BUS_TROUBLE if lasts else Condition.BUS_DISTURBED
            yield self._found(condition, disturbances[0].text)

    def _found(self, condition: Condition, text: str) -> Finding:
        """Finding, with the bus load as its figures if that may be the cause."""
        return Finding(condition, text, self._load if condition in OF_LOAD else "")

    def _of_samples(self, samples: Samples) -> Iterator[Finding]:
        ticks, period_s = self._settings.stale_ticks, self._settings.period_s
        longest = STARVED_FACTOR * ticks
        stale_s, longest_s = (ticks - 0.5) * period_s, (longest - 0.5) * period_s
        awaited = (samples.age_s > 0.0) & ~samples.starting  # late answers have age 0
        self._missing += np.where(awaited, 1, -1)
        np.clip(self._missing, 0, longest, out=self._missing)
        often = self._missing >= longest
        stale = awaited & (samples.age_s > stale_s)
        if stale.any():
            starved = self._since_late < ticks and samples.age_s[stale].max() < longest_s
            text = f"nothing from {self._named(stale)} for {ticks} ticks"
            yield self._found(Condition.STARVED if starved else Condition.STALE, text)
        elif often.any():
            yield self._found(Condition.STALE, f"{self._named(often)} missing in most ticks")
        else:
            yield self._found(Condition.SAMPLE_MISSING, self._named(~samples.fresh))

    def _of_lateness(self, *, late: bool) -> Iterator[Finding]:
        if not (late or self._late):
            return
        self._late = min(self._late + 1.0, LATE_TICKS) if late else max(self._late - LEAK, 0.0)
        self._too_late = self._late > 0.0 and (self._too_late or self._late >= LATE_TICKS)
        if self._too_late and self._mode in SENSING:
            yield Finding(
                Condition.NOT_SENSING, "all answers, late in more than a third of the ticks"
            )

    def _of_sensing(self, sensing: NDArray[np.bool_], settled: bool) -> Iterator[Finding]:
        if self._mode not in SENSING:
            self._not_sensing = 0.0
        elif all(sensing.tolist()):
            # A residual that keeps restarting is as useless as an old one.
            self._not_sensing = max(self._not_sensing - LEAK * settled, 0.0)
        else:
            most = self._settings.not_sensing_ticks
            self._not_sensing = min(self._not_sensing + 1.0, most)
            if self._not_sensing >= most:
                yield Finding(Condition.NOT_SENSING, self._named(~sensing))

    def _named(self, joints: NDArray[np.bool_]) -> str:
        return ", ".join(self._names[i] for i in np.flatnonzero(joints))

    def _of_drives(self, samples: Samples, mode: Mode) -> Iterator[Finding]:
        energised = mode in SENSING
        yield from self._of_supply(mode)
        for i, (name, drive) in enumerate(zip(self._names, samples.drives, strict=True)):
            if _operates(drive):
                continue
            unsupplied = self._supply.missing(i)
            if drive.condition.in_fault:
                yield Finding(Condition.DRIVE_FAULT, f"{name}{', without supply' * unsupplied}")
            elif energised:
                dropped = Condition.SUPPLY_LOST if unsupplied else Condition.DRIVE_DROPPED
                yield Finding(dropped, f"{name} is in {drive.state}")

    def _of_supply(self, mode: Mode) -> Iterator[Finding]:
        """Findings of drives that report operation, but have no supply."""
        for i, name in enumerate(self._names) if mode in SENSING else ():
            if self._supply.lost(i):
                yield Finding(Condition.SUPPLY_LOST, name)

    def _of_time(self, lateness_s: float) -> Iterator[Finding]:
        figures = f"{1000 * lateness_s:.0f} ms late, {self._missed:.0f} deadlines missed"
        if self._missed >= self._settings.overrun_ticks:
            yield Finding(Condition.OVERRUN, figures=figures)
        else:
            yield Finding(Condition.LATE, figures=figures)

    def _of_values(
        self, samples: Samples, mode: Mode, residual: Vector, gaps: Vector
    ) -> Iterator[Finding]:
        implausible = self._plausibility.step(
            samples.link_position,
            samples.motor_velocity,
            samples.motor_position,
            samples.current,
            residual,
            gaps,
            mode in SENSING,
        )
        for finding in implausible:
            if finding.condition is Condition.TORQUE_SATURATED and mode is Mode.ADMITTANCE:
                continue  # a hand that leads the arm may be stronger than the motor
            yield finding
        if mode in SENSING:
            for joint in self._following.not_following(
                samples.motor_velocity, samples.current, samples.fresh
            ):
                figures = self._following.figures(joint)
                yield Finding(Condition.NOT_FOLLOWING, self._names[joint], figures)
            for joint in self._ignored.joints(samples.drives, samples.current, samples.fresh):
                yield Finding(Condition.IGNORES_SETPOINT, self._names[joint])


def _operates(drive: DriveStatus) -> bool:
    return drive.condition is DriveCondition.OPERATING
