"""Deafness: pushes and blows while samples, setpoints or deadlines go missing.

    python -m bench.deafness [--repeat N] [--pairs N] [--minutes M] [--arm NAME] [--json]

Every case runs twice with the same seed, in lockstep: once with losses and once without. An arm
that is armed tracks, yields, returns or holds; a joint is pushed by twice its contact level, or
struck beyond its collision level, at a random time. With losses the push must be felt no later
than 150 ms after it is felt without; or within 150 ms of going deaf the arm stops, or, where it
stands, State says which joint senses nothing. Then a hand leads the arm through losses: it must not
go on by itself before it was quiet, and sensed, for 2 s. Last, 1 % of each drive's samples get
lost: in pairs for the delay, and for some minutes with nobody touching the arm.
"""

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Final, Literal

import click
import numpy as np

from bench.options import help_of
from bench.report import Target, print_report
from bench.rigs.losses import Loss, Mask, Pattern, lossy_steps
from bench.rigs.lossy_arm import ARMS, JOINTS, Run, running
from daemon.commands.options import Range
from daemon.faults.table import Condition
from daemon.modes.table import Event, Mode

MODES: Final = (Mode.TRACKING, Mode.ADMITTANCE, Mode.RETURNING, Mode.HOLDING)
PERIODIC = (
    Pattern(4, 9),
    Pattern(6, 16),
    Pattern(1, 3),
    Pattern(2, 3),
    Pattern(2, 4),
    Pattern(2, 5),
    Pattern(3, 4),
)
RANDOM = tuple(Pattern(share=share) for share in (0.05, 0.1, 0.2, 0.5))
BURSTS = (Pattern(2, 20, burst=True), Pattern(4, 40, burst=True), Pattern(8, 80, burst=True))
PERIOD_S = 0.01
TICKS_WATCHED = 120  # after the push began
LATEST_S = 0.15
LED_S = 3.0
ONE_PERCENT = Loss("samples", Pattern(share=0.01), "each")

Verdict = Literal["felt", "stopped", "told", "deaf"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One push through losses."""

    arm: str
    mode: Mode
    loss: Loss
    joint: int
    blow: bool
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """What came of a push; times [s] after it began, None where it did not happen."""

    felt_s: float | None  # the thresholded residual of its joint had its sign
    lost_ticks: int  # ticks until then in which some sample was lost
    deaf_s: float | None  # its joint began to sense nothing; negative: before the push
    stopped_s: float | None  # the arm had begun to stop, or State said who senses nothing
    resumed_early: bool  # it went on by itself without quiet time that counts


def measure(case: Case, *, lossy: bool) -> Heard:
    """Run one case, with its losses or without."""
    rng = np.random.default_rng(case.seed)
    side = 1.0 if rng.random() < 0.5 else -1.0
    before = int(rng.integers(5, 40))  # ticks of losses before the push
    with running(case.arm) as run:
        run.bring_to(case.mode, (case.joint + 1) % run.n)
        collision = run.rig.tick.estimator.detector.levels.collision[case.joint]
        threshold = run.rig.estimate.threshold[case.joint]
        torque = side * (1.5 * collision if case.blow else 2.0 * threshold)
        lost = case.loss.drawn(rng, before + TICKS_WATCHED, run.n)
        return pushed(run, case, torque, before, lost if lossy else np.zeros_like(lost))


def pushed(run: Run, case: Case, torque: float, before: int, lost: Mask) -> Heard:
    """Push after so many ticks of the losses (ticks, n)."""
    rig, joint = run.rig, case.joint
    loss = case.loss
    steps = lossy_steps(rig, run.wire, loss, lost)
    began = rig.time_s + before * rig.robot.configuration.period_s
    felt_s = deaf_s = stopped_s = None
    missing = 0
    for row in steps:
        run.watch()
        now_s = rig.time_s - rig.robot.configuration.period_s - began
        if now_s >= -1e-9 and not rig.arm.external_torque[joint]:
            run.push(joint, torque)  # felt from the next sample on
        record, estimate = rig.last, rig.estimate
        deaf = not estimate.sensing[joint]
        deaf_s = (now_s if deaf_s is None else deaf_s) if deaf else None
        if now_s <= 0.0:
            continue
        missing += bool(row.any()) and loss.what != "setpoints"
        felt = np.sign(estimate.thresholded[joint]) == np.sign(torque) and not deaf
        if felt and felt_s is None:
            felt_s = now_s
        stops = rig.mode in (Mode.STOPPING, Mode.FAULTED, Mode.OFF) or not record.armed
        told = rig.mode is Mode.HOLDING and not record.sensing.all()
        if (stops or told) and stopped_s is None:
            stopped_s = now_s
        if felt_s is not None:
            break
    return Heard(
        felt_s=felt_s,
        lost_ticks=missing,
        deaf_s=deaf_s,
        stopped_s=stopped_s,
        resumed_early=run.resumed_early,
    )


def verdict(case: Case, lossless: Heard, lossy: Heard) -> Verdict:
    """What came of it, the first that holds."""
    latest = (lossless.felt_s or 0.0) + LATEST_S
    if lossy.felt_s is not None and lossy.felt_s <= latest + 1e-9:
        return "felt"
    if lossy.stopped_s is not None and lossy.stopped_s <= max(lossy.deaf_s or 0.0, 0.0) + LATEST_S:
        return "told" if case.mode is Mode.HOLDING else "stopped"
    return "deaf"


def losses() -> Iterator[Loss]:
    """The population of losses; `None` as a joint is drawn by the case."""
    for pattern in (*PERIODIC, *RANDOM, *BURSTS):
        yield Loss("samples", pattern, 0)
        yield Loss("samples", pattern, "all")
        yield Loss("deadlines", pattern, "all")
    for pattern in RANDOM:
        yield Loss("samples", pattern, "each")
        yield Loss("setpoints", pattern, "each")


def cases(arms: tuple[str, ...], repeat: int) -> Iterator[Case]:
    """Every loss in every mode, with joints, losers, sizes and times drawn by the seed."""
    for number in range(repeat):
        for k, loss in enumerate(losses()):
            for m, mode in enumerate(MODES):
                arm = arms[(k + m + number) % len(arms)]
                seed = 1000 * number + 10 * k + m
                rng = np.random.default_rng(seed)
                n = JOINTS[arm]
                # A push on the joint whose samples are lost, or on another one.
                loser = int(rng.integers(n))
                joint = loser if rng.random() < 0.5 else int(rng.integers(n))
                whose = loser if isinstance(loss.whose, int) else loss.whose
                yield Case(
                    arm=arm,
                    mode=mode,
                    loss=Loss(loss.what, loss.pattern, whose),
                    joint=joint,
                    blow=bool(rng.random() < 0.3),
                    seed=seed,
                )


def led(arm: str, loss: Loss, seed: int) -> tuple[bool, Mode]:
    """A hand leads the arm through losses: whether the arm went on by itself in the hand, and the
    mode in the end."""
    rng = np.random.default_rng(seed)
    with running(arm) as run:
        joint = int(rng.integers(run.n))
        run.bring_to(Mode.ADMITTANCE, joint)
        rig = run.rig
        # Lightly, too: it is felt without losses.
        run.push(joint, rng.uniform(1.2, 2.0) * float(rig.estimate.threshold[joint]))
        lost = loss.drawn(rng, round(LED_S / rig.robot.configuration.period_s), run.n)
        in_the_hand = False
        for _ in lossy_steps(rig, run.wire, loss, lost):
            run.watch()
            in_the_hand |= rig.mode in (Mode.TRACKING, Mode.RETURNING)
        return in_the_hand or run.resumed_early, rig.mode


def untouched(arm: str, minutes: float, seed: int) -> Counter[str]:
    """What happens to an arm that tracks, armed, while 1 % of each drive's samples get lost:
    conditions that stop, hold or disarm it, and contacts. It is armed and started anew after
    each."""
    rng = np.random.default_rng(seed)
    found: Counter[str] = Counter()
    with running(arm) as run:
        run.bring_to(Mode.TRACKING, 0)
        rig = run.rig
        ticks = round(60.0 * minutes / rig.robot.configuration.period_s)
        lost = ONE_PERCENT.drawn(rng, ticks, run.n)
        steps = lossy_steps(rig, run.wire, ONE_PERCENT, lost)
        label = f"{arm}, untouched"
        with click.progressbar(steps, length=ticks, label=label, file=sys.stderr) as shown:
            for _ in shown:
                found.update(n.kind for n in rig.last.notices if n.kind == "contact")
                if rig.mode is Mode.TRACKING and rig.last.armed:
                    continue
                if finding := rig.tick.controller.finding:
                    found[finding.condition.value] += 1
                _go_on(run)
    return found


def _go_on(run: Run) -> None:
    """Bring an arm that stopped back to its trajectory, with nothing lost meanwhile."""
    rig, run.wire.lost = run.rig, set()
    if rig.tick.controller.faulted:
        rig.run(0.5)
        rig.reset()
        rig.enable()
    for _ in range(600):
        if rig.mode is Mode.HOLDING:
            rig.request(Event.START)
        elif rig.mode is Mode.TRACKING and not rig.permit():
            return
        rig.step()
    raise click.ClickException(f"does not go on: {rig.mode}, {rig.last.cause}")


def paired_delays(arms: tuple[str, ...], pairs: int) -> list[float]:
    """Further delays [s] of pushes with 1 % of each drive's samples lost, less one period for each
    tick until then in which a sample was lost."""
    further = []
    for seed in range(pairs):
        arm = arms[seed % len(arms)]
        joint = int(np.random.default_rng(seed).integers(JOINTS[arm]))
        case = Case(
            arm=arm, mode=Mode.TRACKING, loss=ONE_PERCENT, joint=joint, blow=False, seed=seed
        )
        lossless, lossy = (measure(case, lossy=way) for way in (False, True))
        if lossless.felt_s is not None:
            felt_s = np.inf if lossy.felt_s is None else lossy.felt_s
            further.append(felt_s - lossless.felt_s - PERIOD_S * lossy.lost_ticks)
    return further


def line(case: Case, lossless: Heard, lossy: Heard, found: Verdict) -> str:
    """One row of the printed table."""

    def ms(seconds: float | None) -> str:
        return "-" if seconds is None else f"{1000 * seconds:.0f}"

    return (
        f"{case.arm:8} {case.mode:10} {case.loss!s:34} joint {case.joint + 1} "
        f"{'blow' if case.blow else 'push'} {ms(lossless.felt_s):>5} {ms(lossy.felt_s):>5} "
        f"{ms(lossy.deaf_s):>5} {ms(lossy.stopped_s):>5}  {found}"
    )


def targets_of(
    verdicts: Counter[Verdict], resumed: int, further: list[float], found: Counter[str]
) -> list[Target]:
    """Held against limits."""
    other = sum(n for what, n in found.items() if what != Condition.STALE.value)
    return [
        Target(
            "pushes that were neither felt nor answered in time", verdicts["deaf"], 0, "", "lower"
        ),
        Target("arms that went on by themselves without 2 s of quiet", resumed, 0, "", "lower"),
        Target(
            "further delay for each sample lost, p95 at 1 % of losses",
            float(np.percentile(further, 95)) if further else 0.0,
            PERIOD_S + 1e-9,
            "s",
            "lower",
        ),
        Target("stops, holds, contacts at 1 % of losses, but stale", other, 0, "", "lower"),
    ]


@click.command(help=help_of(__doc__))
@click.option("--repeat", type=click.IntRange(min=0), default=2, help="Of the whole population.")
@click.option("--pairs", type=click.IntRange(min=0), default=60, help="Of pushes at 1 % of losses.")
@click.option(
    "--minutes",
    type=Range(min=0.0),
    default=5.0,
    help="Untouched at 1 % of losses, for each arm.",
)
@click.option("--arm", "arms", multiple=True, type=click.Choice(list(ARMS)), help="Only this one.")
@click.option("--json", "as_json", is_flag=True)
def main(repeat: int, pairs: int, minutes: float, arms: tuple[str, ...], as_json: bool) -> None:
    arms = arms or tuple(ARMS)
    if not as_json:
        click.echo("felt [ms] without and with losses, deaf from, stopped or told")
    rows, verdicts, resumed = [], Counter[Verdict](), 0
    for case in cases(arms, repeat):
        lossless, lossy = (measure(case, lossy=way) for way in (False, True))
        found = verdict(case, lossless, lossy)
        verdicts[found] += 1
        resumed += lossy.resumed_early
        plain = asdict(replace(case)) | {"loss": str(case.loss), "mode": case.mode.value}
        rows.append(
            plain | {"lossless": asdict(lossless), "lossy": asdict(lossy), "verdict": found}
        )
        if not as_json:
            click.echo(line(case, lossless, lossy, found))
    for k, loss in enumerate(losses()):
        early, mode = led(arms[k % len(arms)], loss, seed=k)
        resumed += early
        rows.append({"led": str(loss), "mode": mode.value, "resumed_early": early})
    further = paired_delays(arms, pairs)
    found_in = Counter[str]()
    for seed, arm in enumerate(arms):
        found_in += untouched(arm, minutes, seed)
    data = {
        "verdicts": dict(verdicts),
        "not_felt_without_losses": sum(
            row["lossless"]["felt_s"] is None for row in rows if "lossless" in row
        ),
        "untouched_minutes": minutes * len(arms),
        "untouched": dict(found_in),
        "further_s": further,
        "rows": rows,
    }
    if not as_json:
        click.echo(f"{dict(verdicts)}; untouched: {dict(found_in)}")
    print_report(
        "deafness", 0, targets_of(verdicts, resumed, further, found_in), data, as_json=as_json
    )


if __name__ == "__main__":
    main()
