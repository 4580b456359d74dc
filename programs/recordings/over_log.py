"""The estimator over a log that is no recording: residuals and contacts of any samples. Pure.

It begins anew, as after switching on: what a daemon had learned by then is in no log. After a pause
the residual begins at zero. Samples at another period than the configuration's are put on its
raster.
"""

from dataclasses import dataclass

import numpy as np

from common.arrays import Vector
from common.errors import LogError
from daemon.assembly import build_estimator
from daemon.config.schema import Configuration
from estimator.estimate import Estimate
from estimator.model import Model
from identification.motion_log import PAUSE_S, MotionLog
from programs.recordings.contents import ContactSeen
from programs.recordings.raster import on_raster

_ANOTHER = 0.1  # of the period: more is another one
_SLOWEST = 10  # periods between two samples: beyond, what lies between is made up


@dataclass(frozen=True, slots=True)
class OverLog:
    """Residuals and contacts of a log."""

    joints: tuple[str, ...]
    samples: int
    duration_s: float
    largest: Vector
    """of |r| (n,) [Nm]"""
    rms: Vector
    contacts: tuple[ContactSeen, ...]
    notes: tuple[str, ...]


def over_log(log: MotionLog, c: Configuration, model: Model) -> OverLog:
    """Residuals and contacts by the configuration's estimator. Raises LogError where the log lacks
    the motor positions that it takes."""
    if c.estimator.motor_position == "measured" and log.motor_position is None:
        raise LogError("the log has no motor_position of every joint, which the configuration's "
                       "estimator takes (`estimator.motor_position`)")  # fmt: skip
    notes: tuple[str, ...] = ()
    if log.period_s > _SLOWEST * c.period_s:
        raise LogError(f"samples every {log.period_s:.3g} s, the configuration's period is "
                       f"{c.period_s:g} s: at most {_SLOWEST} times as much is allowed; is "
                       "the unit of `time` right?")  # fmt: skip
    if abs(log.period_s / c.period_s - 1.0) > _ANOTHER:
        notes = (f"samples every {1e3 * log.period_s:.3g} ms: taken every "
                 f"{1e3 * c.period_s:.3g} ms, the configuration's period",)  # fmt: skip
        log = on_raster(log, log.stretches(PAUSE_S), c.period_s)
    estimator = build_estimator(c, model)
    begun_s = float(log.time_s[0])
    steps = np.diff(log.time_s, prepend=begun_s - c.period_s)
    contacts: list[ContactSeen] = []
    lasting: dict[str, ContactSeen] = {}
    residuals = []
    for k, step_s in enumerate(steps.tolist()):
        measured = None if log.motor_position is None else log.motor_position[k]
        estimate = estimator.step(
            log.current[k], log.link_position[k], log.motor_velocity[k], measured, step_s
        )
        residuals.append(estimate.residual)
        _follow(estimate, log.joints, float(log.time_s[k]) - begun_s, k, lasting, contacts)
    r = np.array(residuals)
    return OverLog(
        joints=log.joints,
        samples=len(log.time_s),
        duration_s=log.duration_s,
        largest=np.abs(r).max(axis=0),
        rms=np.sqrt(np.square(r).mean(axis=0)),
        contacts=tuple(contacts),
        notes=notes,
    )


def _follow(
    estimate: Estimate,
    joints: tuple[str, ...],
    time_s: float,
    tick: int,
    lasting: dict[str, ContactSeen],
    contacts: list[ContactSeen],
) -> None:
    """Add contacts that begin; let those that last grow, and end where nothing is left of them."""
    for one in estimate.contacts:
        if one.joint in lasting:  # the collision that follows a contact
            lasting[one.joint].level = one.level
            continue
        i = joints.index(one.joint)
        seen = ContactSeen(
            joint=one.joint, time_s=time_s, tick=tick, level=one.level,
            peak=float(estimate.residual[i]), threshold=float(estimate.threshold[i]),
        )  # fmt: skip
        lasting[one.joint] = seen
        contacts.append(seen)
    for name, seen in list(lasting.items()):
        i = joints.index(name)
        if abs(float(estimate.residual[i])) > abs(seen.peak):
            seen.peak = float(estimate.residual[i])
        if estimate.thresholded[i] == 0.0:
            seen.duration_s = time_s - seen.time_s
            del lasting[name]
