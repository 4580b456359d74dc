"""Logs of strangers' arms, from a CSV to levels: what is answered, how right it is, and what not.

    python -m bench.logs [--logs N] [--seed S] [--real FOLDER] [--kept FILE] [--json]

Each log is of a generated arm, written by another program: 10 Hz to 1 kHz, columns up to 10 ms late
or early, jitter, pauses, in degrees or rad, currents or torques, without velocities or motor
positions, with eccentric encoders, soft gears, vibration, or a load that is stated. `contactd new
--log-only`, then `identify` gap, friction, masses and thresholds, as a person types them; torque
constants are looked up, and right within 2 %. `inside`: truths within the stated interval of what
is good; `off`: beyond two of them. Every fifth log lacks what friction needs, or holds a load that
is not stated, which has to be said. --real: a folder of measured logs with published figures. What
is in the file of --kept is not asked again.
"""

import re
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import msgspec
import numpy as np
import pinocchio as pin
from click.testing import CliRunner

from bench.options import JOBS, SEED, command
from bench.report import Target, print_report
from bench.rigs.foreign_logs import Stranger, Style, stranger, urdf_of, write_csv
from bench.rigs.real_logs import real_logs
from bench.study.monte_carlo import spread
from daemon.config.identified import FrictionEntry
from daemon.config.load import load_robot
from identification.regression import NORMAL_95
from programs.contactd.contactd import main as contactd
from programs.identify.log_names import beside

STEPS = ("gap", "masses", "friction", "thresholds")
SECONDS, LOAD_KG, LOADED = 60.0, 0.2, 0.25
MASSES = 4  # logs for one whose masses are asked for: they take as long as all else
COEFFICIENTS = {
    "friction": "K_theta_s", "viscous friction": "K_theta_v", "rotor": "B",
    "load friction": "K_load",
}  # fmt: skip
PARAMETERS = {"mass": slice(0, 1), "first moment": slice(1, 4), "inertia": slice(4, 10)}
LACKS = {
    "no torque": (Style(without=("cur",)), "a torque or current"),
    "no position": (Style(without=("pos", "motor_pos")), "has a position"),
    "one position": (Style(without=("motor_pos",), one_encoder=True), "as of one encoder"),
    "too short": (Style(longest_s=4.0), "of motion"),
    "a load": (Style(), "`contactctl payload"),
}
"""Lack of a log, and words of the answer that name it."""

MOTIONS: dict[str, tuple[Callable[[Style, Stranger], bool], str]] = {
    "a fast log": (lambda style, _: style.rate_Hz < 12.5, "log faster"),
    "a steady arm": (
        lambda _, of: bool((np.percentile(np.abs(of.log.motor_velocity), 99, axis=0) > 1.0).any()),
        "swing",
    ),
}
"""Motions that show no friction, though the rest may be answered, and words of the answer."""


@dataclass(slots=True)
class Found:
    """Answers of one log: (quantity, joint, error over its interval), good or not."""

    log: int
    style: str
    errors: list[tuple[str, str, float]] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    asked: int = 0
    shown: bool = True
    commands: int = 0
    seconds: float = 0.0
    lacks: str = ""
    cause_named: bool = False


def style_of(rng: np.random.Generator, seed: int) -> Style:
    """Another program's way to write a log."""
    late = [float(rng.uniform(-0.01, 0.01)) * bool(rng.integers(2)) for _ in range(2)]
    without = (("vel",), ("motor_pos",), (), (), ())[int(rng.integers(5))]
    return Style(
        rate_Hz=float(rng.choice([10.0, 25.0, 50.0, 100.0, 200.0, 500.0, 1000.0])),
        late_s={"motor_velocity": late[0], "current": late[1]},
        jitter=float(rng.choice([0.0, 0.0, 0.1, 0.3])),
        pauses=int(rng.choice([0, 0, 2])),
        without=without,
        torque=bool(rng.integers(2)),
        degrees=bool(rng.integers(2)),
        eccentric=float(rng.choice([0.0, 0.0, 0.0005, 0.0015])),
        vibration=(float(rng.choice([0.0, 0.0, 0.5])), float(rng.uniform(8.0, 20.0))),
        seed=seed,
    )


def typed(found: Found, *words: object) -> str:
    """Output of a command of `contactd`."""
    found.commands += 1
    return CliRunner().invoke(contactd, [str(word) for word in words]).output


def look_up(config: Path, of: Stranger, rng: np.random.Generator, *, torque: bool) -> None:
    """Write torque constants as a data sheet has them into a drafted configuration."""
    if torque:
        return
    sheet = iter(of.truth.torque_constant * rng.uniform(0.98, 1.02, of.log.n))
    text = re.sub(r"torque_constant: .*", lambda _: f"torque_constant: {next(sheet):.6g}",
                  config.read_text())  # fmt: skip
    config.write_text(text)


def examine(job: tuple[int, int]) -> Found:
    """Write one log, and ask everything about it."""
    seed, k = job
    rng = np.random.default_rng((seed, k))
    lacks = list(LACKS)[k // 5 % len(LACKS)] if k % 5 == 4 else ""
    style = LACKS[lacks][0] if lacks else style_of(rng, k)
    load_kg = LOAD_KG * bool(not lacks and rng.random() < LOADED)
    found = Found(k, f"{style}, {load_kg} kg", lacks=lacks)
    with tempfile.TemporaryDirectory() as made:
        folder, number = Path(made), 1000 * seed + k
        right = k % (2 * MASSES) not in (0, 3)
        of = stranger(number, SECONDS, folder / "truth", load_kg=load_kg, by_urdf=right)
        log, arm = write_csv(of, style, folder / "log.csv"), folder / "arm"
        begun = time.monotonic()
        said = typed(found, "new", arm, "--log-only", "--urdf", urdf_of(of, folder), log)
        given = ("--config", arm, "--log", log)
        if lacks:
            later = None
            if lacks == "a load":
                carrying = stranger(number, SECONDS, folder / "carrying", load_kg=2.0 * LOAD_KG)
                later = write_csv(carrying, style, folder / "later.csv")
            said += lacking(found, given, later)
            found.cause_named = LACKS[lacks][1] in " ".join(said.split())
            return found
        found.asked = 2 * of.log.n  # friction and levels; whether a motion shows a gap is its own
        if not arm.exists():
            found.refused = [said]
            return found
        if load_kg:
            with beside(log).open("a") as names:
                names.write(f"payload: {load_kg}\n")
        look_up(arm / "config.yaml", of, rng, torque=style.torque)
        said = "".join(
            typed(found, "identify", step, *given)
            for step in STEPS
            if step != "masses" or k % MASSES == 0
        )
        found.refused = re.findall(r"^  (\w+: .*)$", said, re.MULTILINE)
        typed(found, "plot", log, "--config", arm, "-o", folder / "page.html")
        found.seconds = time.monotonic() - begun
        found.shown = style.vibration[0] == 0.0
        for motion, (is_such, words) in MOTIONS.items():
            if is_such(style, of):
                found.lacks, found.cause_named = motion, words in " ".join(said.split())
        score(found, arm, of)
    return found


def lacking(found: Found, given: tuple[str | Path, ...], loaded: Path | None) -> str:
    """Answers about a log that lacks something, or, `loaded`, about a later one of the same arm
    with a load."""
    arm, log = Path(given[1]), Path(given[3])
    if not arm.exists():
        return ""
    if loaded is None:
        step = "gap" if found.lacks == "one position" else "friction"
        said = typed(found, "identify", step, *given)
        identified = load_robot(arm).identified
        found.errors = [(step, name, 9.0) for name in (identified.joints if identified else ())]
        return said
    for step in STEPS:
        typed(found, "identify", step, *given)
    beside(loaded).write_text(beside(log).read_text())
    return typed(found, "replay", loaded, "--config", arm)


def examine_real(data: Path) -> Found:
    """Ask about measured logs what is published of them."""
    found = Found(-1, "measured by others")
    with tempfile.TemporaryDirectory() as made:
        for one in real_logs(data, Path(made)):
            if one.urdf:
                typed(found, "new", one.arm, "--log-only", "--urdf", one.urdf, one.path)
            said = typed(found, "identify", *one.asks, "--config", one.arm, "--log", one.path)
            found.refused.append(said)
            identified = load_robot(one.arm).identified
            for name, true in one.truths.items():
                joint = identified.joints.get(name) if identified else None
                if one.quantity == "gap" and joint and joint.gap and joint.gap.confidence:
                    error = (joint.gap.half_gap - true) / joint.gap.confidence
                    found.errors.append(("gap", name, float(np.nan_to_num(error, nan=9.0))))
                if one.quantity == "friction" and joint and joint.friction:
                    found.errors += [
                        (q, name, e) for q, e in friction_errors(joint.friction, K_theta_s=true)
                    ]
    found.commands = 0
    return found


def friction_errors(entry: FrictionEntry, **true: float) -> Iterator[tuple[str, float]]:
    """Quantities of `COEFFICIENTS` that were identified, and their errors over their intervals."""
    f, off = entry.friction, entry.errors
    found = {
        "K_theta_s": (f.motor_coulomb + f.link_coulomb, NORMAL_95 * off.get("K_theta_s", 0.0)),
        "K_theta_v": (f.motor_viscous + f.link_viscous, NORMAL_95 * off.get("K_theta_v", 0.0)),
        "B": (entry.rotor_inertia or 0.0, NORMAL_95 * off.get("B", 0.0)),
        "K_load": (0.5 * sum(f.load or (0.0,)), 0.5 * float(np.ptp(f.load or 0.0))),
    }
    for quantity, name in COEFFICIENTS.items():
        value, interval = found[name]
        if interval > 0.0 and name in true:
            yield quantity, float((value - true[name]) / interval)


def score(found: Found, arm: Path, of: Stranger) -> None:
    """Compare what is identified with the truth."""
    identified = load_robot(arm).identified
    for i, name in enumerate(of.log.joints):
        joint = identified.joints.get(name) if identified else None
        if joint is None:
            continue
        if joint.gap is not None and joint.gap.confidence:
            error = (joint.gap.half_gap - of.truth.half_gap[i]) / joint.gap.confidence
            found.errors.append(("gap", name, float(error)))
        if joint.friction is not None:
            viscous = of.truth.viscous.reshape(2, -1).sum(axis=0)
            true = {"K_theta_s": of.friction[i], "K_theta_v": viscous[i], "K_load": 0.0,
                    "B": of.truth.rotor_inertia[i]}  # fmt: skip
            found.errors += [(q, name, e) for q, e in friction_errors(joint.friction, **true)]
        if joint.masses is not None:
            body = joint.masses.body
            inertia = pin.Inertia(body.mass, np.array(body.com), body.tensor())
            errors = NORMAL_95 * np.array(joint.masses.errors)
            off = (inertia.toDynamicParameters() - of.bodies[i]) / errors
            found.errors += [(q, name, float(e)) for q, at in PARAMETERS.items() for e in off[at]]
        if joint.thresholds is not None:
            found.errors.append(("levels", name, 0.0))


def shares(found: list[Found]) -> Iterator[Target]:
    """Targets over all logs."""
    for quantity in ("gap", *COEFFICIENTS, *PARAMETERS):
        sizes = np.abs([e for one in found for q, _, e in one.errors if q == quantity])
        if not len(sizes):  # no log gave it
            continue
        inside = 100.0 * float((sizes <= 1.0).mean())
        yield Target(f"{quantity}: truths inside what is good", inside, 95.0, "%", "higher")
        yield Target(f"{quantity}: good, and off by two intervals", float((sizes > 2.0).sum()), 0)
    whole = [one for one in found if not one.lacks and one.log >= 0]
    shown = [one for one in whole if one.shown]
    answers = sum(q in {"friction", "levels"} for one in shown for q, _, _ in one.errors)
    asked = sum(one.asked for one in shown)
    yield Target("answered where it is shown", 100.0 * answers / max(asked, 1), 80.0, "%", "higher")
    lacking = [one.cause_named for one in found if one.lacks]
    named = 100.0 * float(np.mean(lacking)) if lacking else float("nan")
    yield Target("refused with the right cause", named, 90.0, "%", "higher")
    yield Target("commands from a CSV to a page", max((o.commands for o in whole), default=0), 10)
    slowest = max((one.seconds for one in whole), default=0.0)
    yield Target("the slowest of them", slowest / 60.0, 10.0, "min")


@command(__doc__)
@click.option("--logs", type=click.IntRange(min=5), default=60)
@click.option("--real", type=click.Path(path_type=Path, exists=True))
@click.option("--kept", type=click.Path(path_type=Path), help="Answers, a line each, added to.")
@JOBS
@SEED
def main(
    logs: int, real: Path | None, kept: Path | None, processes: int, seed: int, as_json: bool
) -> None:
    lines = kept.read_bytes().splitlines() if kept and kept.exists() else []
    found = [msgspec.json.decode(line, type=Found) for line in lines]
    jobs = [(seed, k) for k in range(logs) if k not in {one.log for one in found}]
    for one in spread(examine, jobs, processes, f"{len(jobs)} logs"):
        found.append(one)
        if kept:
            with kept.open("ab") as stream:
                stream.write(msgspec.json.encode(one) + b"\n")
    if real:
        found.append(examine_real(real))
    rows: list[dict[str, Any]] = [
        {"log": one.log, "style": one.style, "lacks": one.lacks, "errors": one.errors,
         "refused": one.refused, "seconds": one.seconds, "cause_named": one.cause_named}
        for one in sorted(found, key=lambda one: one.log)
    ]  # fmt: skip
    print_report("logs", seed, list(shares(found)), {"logs": rows}, as_json=as_json)


if __name__ == "__main__":
    main()
