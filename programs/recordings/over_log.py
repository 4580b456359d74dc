"""Conversion of another program's log to the States that a daemon would have recorded.

The estimator starts afresh, as after switching on, as a log does not contain what was learned. The
arm counts as holding throughout, as its commands are unknown. After a pause the residual starts at
zero. Samples at another period than the configured one are resampled. Pure functions.
"""

from typing import Final

import numpy as np
from msgspec.structs import replace

from common.errors import LogError
from daemon.assembly import build_estimator
from daemon.config.load import Robot
from daemon.modes.table import Mode
from daemon.protocol.state import Notice, Snapshot, State
from daemon.service.status import context_of
from daemon.tick.decision import Decision
from daemon.tick.load_watch import LoadWatch
from daemon.tick.sensing import Sensing
from daemon.tick.telemetry import TickRecord, Wakeup, contact_notice, state_of
from drivers.api import DriveCondition, DriveStatus, Samples
from estimator.payload import Payload
from identification.motion_log import PAUSE_S, MotionLog
from programs.recordings.raster import on_raster

CAUSE: Final = "a log of another program"
_ANOTHER = 0.1  # relative deviation of the period above which the log is resampled
_SLOWEST = 10  # longest sampling period, in periods: above, samples would be mostly interpolated
_CLOCK_S = 1e8  # larger times are Unix times
_DRIVE = DriveStatus(DriveCondition.OPERATING, "not in the log", "", True, True)


def over_log(
    log: MotionLog, robot: Robot, notes: tuple[str, ...] = (), payload: Payload | None = None
) -> tuple[Snapshot, list[State]]:
    """Snapshot and States of a log by the robot's estimator. Notes become notices of the first
    State; a load other than `payload` is recognised as in the daemon. Raises LogError if the log
    lacks motor positions that the estimator needs."""
    c = robot.configuration
    if c.estimator.motor_position == "measured" and log.motor_position is None:
        raise LogError("the log lacks motor_position of some joints, which the configured "
                       "estimator needs (`estimator.motor_position`)")  # fmt: skip
    if log.period_s > _SLOWEST * c.period_s:
        raise LogError(f"samples every {log.period_s:.3g} s, the configuration's period is "
                       f"{c.period_s:g} s: at most {_SLOWEST} times as much is allowed; is "
                       "the unit of `time` right?")  # fmt: skip
    if abs(log.period_s / c.period_s - 1.0) > _ANOTHER:
        notes += (f"samples every {1e3 * log.period_s:.3g} ms: resampled to "
                  f"{1e3 * c.period_s:.3g} ms, the configured period",)  # fmt: skip
        log = on_raster(log, log.stretches(PAUSE_S), c.period_s)
    estimator = build_estimator(c, robot.model)
    begun_s = float(log.time_s[0])
    estimator.carry(payload)
    sensing, watch = Sensing(log.n, c.estimator.gain), LoadWatch(estimator)
    watch.announce(payload)
    snapshot = replace(context_of(robot), memory=estimator.memory())
    zero, fresh = np.zeros(log.n), np.ones(log.n, dtype=np.bool_)
    news = [Notice(kind="mode", text=note) for note in notes]
    states = []
    for k, step_s in enumerate(np.diff(log.time_s, prepend=begun_s - c.period_s).tolist()):
        measured = None if log.motor_position is None else log.motor_position[k]
        samples = Samples(
            log.current[k], log.link_position[k], log.motor_velocity[k], measured,
            fresh, zero, ~fresh, (_DRIVE,) * log.n,
        )  # fmt: skip
        estimate = estimator.step(
            samples.current, samples.link_position, samples.motor_velocity, measured, step_s
        )
        since_s = float(log.time_s[k]) - begun_s
        sensing.step(since_s, estimate)
        news += watch.step(Mode.HOLDING, estimate, sensing)
        velocity = zero if log.setpoint is None else log.setpoint[k]
        record = TickRecord(
            number=k,
            time_s=since_s,
            wakeup=Wakeup(since_s, wall_s=since_s + begun_s * (begun_s > _CLOCK_S)),
            samples=samples,
            interval_s=step_s,
            estimate=estimate,
            sensing=estimate.sensing,
            sensing_since_s=zero,
            decision=Decision(
                power=(), reset=False, velocity=velocity, reference=samples.link_position
            ),
            mode=Mode.HOLDING,
            cause=CAUSE,
            payload=payload,
            recognised=watch.found,
            notices=(*news, *map(contact_notice, estimate.contacts)),
        )
        states.append(state_of(record))
        news = []
    return snapshot, states
