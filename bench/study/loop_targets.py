"""Targets of `bench.loop`."""

from bench.report import Target
from bench.study.loop_run import Run
from daemon.modes.table import Mode


def targets_of(run: Run, *, load: bool) -> list[Target]:
    """Targets that hold at this rate, and what they are held against."""
    at = f"{run.joints} {'joint' if run.joints == 1 else 'joints'} at {run.hz} Hz: "
    period_us = 1e6 / run.hz
    targets = [
        # A loop that counted its periods from its own wake-ups would lose whole periods.
        Target(at + "drift over the run", run.drift_us, 0.1 * period_us, "us")
    ]
    if run.joints > 1:
        cpu = run.cpu_us.at(50) / 1e3
        targets.append(Target(at + "CPU time of a tick, median", cpu, 0.5, "ms"))
    tracking = float(run.mode == Mode.TRACKING)
    targets.append(Target(at + "tracking all the time", tracking, 1.0, "", "higher"))
    if run.rival_us is not None:
        targets += _of_wakeups(run, at, period_us)
    if run.hz == 250 and load:
        late = run.work_us.at(99)
        targets.append(Target(at + "tick, p99", late, 0.5 * period_us, "us"))
        name = f"deadlines missed, at most the {run.rival}'s"
        targets.append(Target(at + name, run.missed, run.rivals_missed))
    return targets


def _of_wakeups(run: Run, at: str, period_us: float) -> list[Target]:
    assert run.rival_us is not None
    ratio = run.lateness_us.at(50) / max(run.rival_us.at(50), 1.0)
    late, others = run.lateness_us.beyond(period_us), run.rivals_late
    name = f"wake-ups later than a period, at most the {run.rival}'s"
    return [
        Target(f"{at}median lateness over the {run.rival}'s", ratio, 2.0),
        Target(at + name, late, others),
    ]
