"""Death of a stream: time until the setpoints of an arm that followed it are zero.

The whole tick runs, around an arm of the population without a bus: the position loop and the arm's
lag are part of the setpoints. A joint stands from the first tick on in which its setpoint is zero;
then its pose is held, and if the link falls through its gap, the loop follows it.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from bench.rigs.arm_in_the_loop import ArmInTheLoop
from bench.study import world
from bench.study.streamed import Arrival, arrivals, hand
from daemon.config.load import Robot
from daemon.config.vectors import limits_of, stream_settings_of
from daemon.modes.table import Event, Mode
from daemon.motion.playout import Target
from daemon.motion.target_stream import BRAKED_S, TargetStream

DEATHS: Final = (
    "silence", "ever later", "repeated", "clock stands", "clock runs back", "no numbers",
)  # fmt: skip
STANDS: Final = 0.02  # setpoint that counts as zero [rad/s]
SECONDS: Final = 8.0


def dying(way: str, coming: list[Arrival], at_s: float) -> list[Arrival]:
    """Targets of which none from `at_s` on is reliable."""
    alive = [one for one in coming if one.at_s < at_s]
    last = alive[-1].target
    after = [one for one in coming if one.at_s >= at_s]

    def spoiled(k: int, one: Arrival) -> Arrival:
        target = one.target
        match way:
            case "ever later":
                return Arrival(one.at_s + 0.2 + 0.9 * (one.at_s - at_s), target)
            case "repeated":
                target = last
            case "clock stands":
                target = Target(last.number + k + 1, last.sent_s, target.q)
            case "clock runs back":
                target = Target(last.number + k + 1, last.sent_s - 0.01 * (k + 1), target.q)
            case "no numbers":
                target = Target(target.number, target.sent_s, np.full_like(target.q, np.nan))
        return Arrival(one.at_s, target)

    if way == "silence":
        return alive
    return sorted(alive + [spoiled(k, one) for k, one in enumerate(after)], key=lambda a: a.at_s)


@dataclass(frozen=True, slots=True)
class Death:
    """End of one stream."""

    stands_s: float  # from the last reliable target, minus the braking time
    held_rad: float  # largest motion of a joint while holding afterwards


def death(robot: Robot, way: str, rate_hz: float, seed: int) -> Death:
    """Death of a stream during a motion. Raises RuntimeError if the arm did not follow it."""
    c, limits = robot.configuration, limits_of(robot.configuration)
    motion = hand(limits, SECONDS, seed)
    coming = arrivals(motion, rate_hz, SECONDS, seed)
    at_s = 4.0 + 2.0 * float(np.random.default_rng((seed, 45)).random())
    coming = dying(way, coming, at_s)
    last_s = max(one.at_s for one in coming if one.at_s < at_s)
    on = ArmInTheLoop(world.subject(robot, world.LAWS[seed % 3], seed), robot, motion(0.0))
    stream = TargetStream("the bench", stream_settings_of(c), limits, coming[0].target)
    on.run(0.5)
    on.request(Event.ENABLE)
    on.run(0.5)
    on.request(Event.START, stream)
    begun_s, k = on.time_s, 0
    fastest, stood_s = np.zeros_like(limits.velocity), np.full_like(limits.velocity, np.nan)
    held, furthest = np.zeros_like(fastest), 0.0
    while (now_s := on.time_s - begun_s) < SECONDS:
        while k < len(coming) and coming[k].at_s <= now_s:
            stream.put(coming[k].target)
            k += 1
        on.step()
        if now_s < last_s:
            if on.mode is not Mode.TRACKING:
                raise RuntimeError(f"{on.mode} after {now_s:.2f} s, seed {seed}")
            continue
        velocity = on.tick.controller.motion.velocity
        stood = np.isfinite(stood_s)
        if stream.silent_s > BRAKED_S:
            stood_s[(np.abs(velocity) < STANDS) & ~stood] = now_s
        fastest[~stood] = np.maximum(fastest, np.abs(velocity))[~stood]
        held[stood] += velocity[stood] * on.period_s
        furthest = max(furthest, float(np.abs(held).max()))
    late_s = stood_s - last_s - fastest / limits.acceleration
    return Death(float(late_s.max()), furthest)
