"""`contactd new --log-only`: creates the folder of an arm that is known from logs alone."""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from shlex import quote

import click
import numpy as np

from common.errors import ConfigurationError, LogError, ModelError
from common.regular_file import read_text
from daemon.config.load import load_robot
from estimator.urdf import JointRange, joint_ranges
from identification.skew import without_skew
from identification.torque_columns import refuse_other_torques
from programs.command_line.sentences import say
from programs.contactd.drafts.configuration import guesses, loads_of
from programs.contactd.drafts.log_arm import TURNS, Scale, log_draft, scales, with_movable_joints
from programs.contactd.drafts.log_columns import Columns, guessed, named_columns
from programs.identify.csv_log import header_of, is_mcap, numbers_of, read_csv, there_are
from programs.identify.foreign import joined
from programs.identify.guesses import OTHERS
from programs.identify.log_names import NamedLog, beside, read_names
from programs.identify.mcap_log import headers

_AS_IT_IS = (0.4, 2.5)  # torque scales that rather reflect errors of the URDF's masses


def new_log_arm(folder: Path, urdf: Path, logs: Sequence[Path]) -> None:
    """Write a configuration into a new folder and a names file beside each log that has none, and
    print both. Nothing is overwritten, and no partial file is left. Raises ContactdError."""
    if folder.exists():
        raise ConfigurationError(f"{folder} exists: it is never overwritten")
    written: list[Path] = []
    try:
        draft, columns, changes = _write(folder, urdf, logs, written)
        load_robot(folder)
    except BaseException as error:
        for path in written:
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
        if isinstance(error, ModelError):
            raise ConfigurationError(f"{urdf}: {error}") from error
        if isinstance(error, OSError | UnicodeDecodeError):
            why = getattr(error, "strerror", None) or error
            raise ConfigurationError(f"{urdf} or {folder}: {why}") from error
        raise
    for text, names in {found.text(): beside(log) for log, found in columns.items()}.items():
        click.echo(f"wrote {names}:\n\n{text}")
    click.echo(f"wrote {folder / 'config.yaml'}: {guesses(draft)} lines with CHECK hold guesses")
    for change in changes:
        say(f"{folder / urdf.name}: {change}")
    arm, first, *others = (quote(str(path)) for path in (folder, *logs))
    steps = ["masses", "friction", "thresholds"]
    if "half_gap: 0.002" in draft:
        steps.insert(0, "gap")
    also = ", and --log LOG added for other logs without a touch" if others else ""
    click.echo(f"next, once columns and constants are right{also}:")
    for step in steps:
        click.echo(f"  contactd identify {step} --config {arm} --log {first}")
    click.echo(f"  contactd plot {first} --config {arm}")
    for other in others:
        click.echo(f"  contactd replay {other} --config {arm}")


def _write(
    folder: Path, urdf: Path, logs: Sequence[Path], written: list[Path]
) -> tuple[str, Mapping[Path, Columns], list[str]]:
    text = read_text(urdf)
    ranges = [
        replace(one, lower=-TURNS, upper=TURNS) if one.kind == "continuous" else one
        for one in joint_ranges(text)
        if one.kind in ("continuous", "revolute")
    ]
    given = {log: known for log in logs if (known := read_names(log)) is not None}
    columns = {log: _columns(log, urdf, ranges) for log in logs if log not in given}

    def write_names() -> None:
        for log, one in columns.items():
            written.append(beside(log))
            beside(log).write_text(one.text(), encoding="utf-8")

    write_names()
    there = [{*one.joints} for one in columns.values()]
    there += [{name.partition(".")[2] for name in one.conversions} for one in given.values()]
    text, changes = with_movable_joints(text, set.intersection(*there))
    ranges = [one for one in joint_ranges(text) if one.kind == "revolute"]
    names = [one.joint for one in ranges]
    loads_of(text, urdf.name, names)  # of lengths in mm no step makes anything
    log, _ = joined([read_csv(path, names, dict.fromkeys(names, 1.0))[0] for path in logs])
    folder.mkdir(parents=True)
    written.append(folder)
    (folder / urdf.name).write_text(text, encoding="utf-8")

    def drafted(constants: Sequence[tuple[float, str]]) -> str:
        draft = log_draft(folder.resolve().name, urdf.name, log, ranges, constants)
        (folder / "config.yaml").write_text(draft, encoding="utf-8")
        return draft

    drafted([(1.0, "")] * len(names))
    robot = load_robot(folder)
    aligned, _ = without_skew(log, robot.model, robot.configuration.estimator)
    refuse_other_torques(aligned, robot.model, robot.configuration.estimator)
    found = scales(aligned, robot.model)
    shown = [one for one in found if one.constant]
    usual = float(np.median([abs(one.constant) for one in shown] or [1.0]))
    # One program wrote all columns: if most torques are at the link side, all are.
    at_link, known = _AS_IT_IS[0] < usual < _AS_IT_IS[1], read_names(logs[0])
    constants = [
        _constant(name, one, usual, known, at_link=at_link)
        for name, one in zip(names, found, strict=True)
    ]
    factors = {name: (one[0], one[2]) for name, one in zip(names, constants, strict=True)}
    columns = {path: one.scaled(factors) for path, one in columns.items()}
    write_names()
    if columns:
        log = replace(log, current=log.current * np.array([factors[name][0] for name in names]))
    # Torques at the link side need no constant, so the URDF's masses do not cast doubt on it.
    kept = {name for name in names if at_link and known and f"torque.{name}" in known.conversions}
    marked = [
        (k, "" if name in kept else why) for name, (_, k, why) in zip(names, constants, strict=True)
    ]
    return drafted(marked), columns, changes


def _columns(log: Path, urdf: Path, ranges: Sequence[JointRange]) -> Columns:
    """Guessed columns of a log; of an MCAP, those of the topic with the most matching fields.
    Raises LogError if no joint is found in it."""
    joints = [one.joint for one in ranges]
    by_topic = headers(log) if is_mcap(log) else {"": header_of(log)}
    topic = max(by_topic, key=lambda one: len(named_columns(by_topic[one], joints)), default="")
    header = by_topic.get(topic)
    if not header:
        raise LogError(f"{log}: empty: it has no column names and no messages")
    named = named_columns(header, joints)
    there = f"{there_are(header)}; name them in {beside(log).name} beside it (docs/logs.md)"
    if ("", "time") not in named:
        raise LogError(f"{log}: no column has the name of a time; {there}")
    table = numbers_of(log, list(dict.fromkeys(named.values())), named["", "time"], topic)
    found = replace(guessed(named, table, ranges), topic=topic)
    if not found.joints:
        raise LogError(f"{log}: no joint of {urdf.name} ({', '.join(joints)}) has a position and a "
                       f"torque or current among the column names; {there}")  # fmt: skip
    return found


def _constant(
    joint: str, scale: Scale, usual: float, named: NamedLog | None, *, at_link: bool
) -> tuple[float, float, str]:
    """Factor of a joint's column, its torque constant [Nm/A], and the reason. usual: median of all
    joints' constants; at_link: the log's torques are at the link side."""
    k = scale.constant
    if named is not None and f"torque.{joint}" in named.conversions:
        if not k:
            return (-1.0 if scale.against else 1.0), 1.0, str(scale)
        return (float(np.sign(k)) if at_link else k), 1.0, f"{k:.3g} {scale}"
    if not k:
        sign = -1.0 if scale.against else 1.0
        return sign, usual, f"{OTHERS}: {scale}; it is the motor's, times the gear"
    return (1.0 if k > 0.0 else -1.0), abs(k), str(scale)
