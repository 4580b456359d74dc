"""`contactd whatif`: contacts that recordings would have had with other levels, residuals or
settings."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import click
import msgspec
import numpy as np

from common.errors import LogError
from common.new_file import refuse_suffix, refuse_unless_new, whole_file
from programs.command_line.progress import counting, reading
from programs.contactd.whatif_words import counted, lines
from programs.recordings.detection import Detection, Point, Total
from programs.recordings.html import filled
from programs.recordings.labels import labels_of, proposed, read_labels, template
from programs.recordings.many import LabelledRecording, answers, recordings_in
from programs.recordings.question import ARM, Answer, Question
from programs.recordings.reading import read_contents
from programs.recordings.settings import parse_change

MOST_LEVELS: Final = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """Arguments and options of the command line."""

    places: tuple[Path, ...]
    thresholds: tuple[str, ...]
    collisions: tuple[str, ...]
    residual: str
    settings: tuple[str, ...]
    fresh: bool
    until_reaction: bool
    labels: Path | None
    per_hour: float
    workers: int
    scheduler: str
    output: Path | None
    config: Path | None
    as_json: bool


def print_whatif(request: Request) -> bool:
    """Evaluate the recordings and report; True if all were complete. Raises ContactdError."""
    if request.output is not None:
        refuse_suffix(request.output, (".html", ".htm"))
    question = Question(
        levels=_levels_of(request.thresholds, "--threshold"),
        collisions=_levels_of(request.collisions, "--collision"),
        residual=request.residual,
        changes=tuple(parse_change(text) for text in request.settings),
        fresh=request.fresh,
        until_reaction=request.until_reaction,
    )
    read = _recordings_of(request.places, request.config)
    files = list(read.values())
    labels = read_labels(request.labels) if request.labels else {}
    alone = len(files) == 1
    asked = [
        LabelledRecording(str(recording), tuple(labels_of(labels, f, alone=alone)))
        for recording, f in read.items()
    ]
    if labels and not any(one.labels for one in asked):
        raise LogError(f"{request.labels}: its labels are for other files: {', '.join(labels)}")
    total = Total()
    shown = not request.as_json
    with (
        counting(len(files), shown=shown) as done,
        reading(files[0], shown=shown and alone) as progress,
    ):
        for answer in answers(question, asked, request.workers, request.scheduler, progress):
            named = str(read[Path(answer.file)])
            answer.failed, answer.file = answer.failed.replace(answer.file, named), named
            total.add(answer)
            done()
    total.answers.sort(key=lambda answer: answer.file)
    found = total.detections(request.per_hour)
    if request.output is not None:
        _write_page(request.output, total, found, request.per_hour)
    if request.as_json:
        click.echo(msgspec.json.encode(data(total, found)))
    else:
        for line in lines(question, request.per_hour, total, found):
            click.echo(line)
    for answer in sorted([*total.failed, *total.broken], key=lambda answer: answer.file):
        click.echo(f"contactd: {answer.failed or _ends_early(answer)}", err=True)
    return total.complete


def _ends_early(answer: Answer) -> str:
    return f"{answer.file} {answer.broken}"


def _recordings_of(places: Sequence[Path], config: Path | None) -> dict[Path, Path]:
    """File that each recording comes from: itself, or a log of another program."""
    if config is None:
        files = recordings_in(places)
        if foreign := next((file for file in files if file.suffix == ".csv"), None):
            raise click.UsageError(f"{foreign}: needs --config, the robot's folder")
        return {file: file for file in files}
    from programs.identify.foreign import recording_of  # noqa: PLC0415 - slow

    return {recording_of(file, config): file for file in recordings_in(places, ".csv")}


def write_template(places: Sequence[Path], target: Path, config: Path | None = None) -> bool:
    """Write the contacts of recordings as labels to be corrected; True if all could be read."""
    refuse_unless_new(target)
    rows, complete = [], True
    for recording, file in _recordings_of(places, config).items():
        try:
            contents, broken = read_contents(recording)
        except LogError as error:
            click.echo(f"contactd: {error}", err=True)
            complete = False
            continue
        if broken:
            click.echo(f"contactd: {broken}", err=True)
            complete = False
        rows += proposed(contents, file.name)
    with whole_file(target) as partial:
        partial.write_text(template(rows), encoding="utf-8")
    touches = counted(len(rows), "touch", "touches")
    click.echo(f"{touches} proposed: {target}; correct begin, end and joint of each")
    return complete


def _levels_of(texts: Sequence[str], option: str) -> dict[str, tuple[float, ...]]:
    """Levels by joint. Raises UsageError, also for a joint that is named twice."""
    parsed = [parse_levels(text, option) for text in texts]
    levels = dict(parsed)
    if len(levels) < len(parsed):
        raise click.UsageError(f"{option} names a joint twice: {' '.join(texts)}")
    return levels


def parse_levels(text: str, option: str) -> tuple[str, tuple[float, ...]]:
    """Joint and levels from `JOINT=LOW:HIGH:STEP` or `JOINT=A,B`. Raises UsageError."""
    joint, _, levels = text.partition("=")
    try:
        found = _levels(levels)
    except ValueError:
        found = []
    if not joint or not found or not all(0.0 < level < math.inf for level in found):
        raise click.UsageError(
            f"{option} {text}: must be JOINT=LOW:HIGH:STEP or JOINT=A,B in Nm, above 0, at most "
            f"{MOST_LEVELS} levels"
        )
    return joint, tuple(found)


def _levels(text: str) -> list[float]:
    """Levels in ascending order; empty for an empty range. Raises ValueError if not numeric."""
    if ":" not in text:
        return sorted({float(part) for part in text.split(",")})
    low, high, step = (float(part) for part in text.split(":"))
    if not (0.0 < step < math.inf and 0.0 <= high - low < MOST_LEVELS * step):
        return []
    count = math.floor((high - low) / step + 1e-9) + 1
    levels: list[float] = np.round(low + step * np.arange(count), 9).tolist()
    return levels


def data(total: Total, found: Sequence[Detection]) -> dict[str, Any]:
    """All results for JSON; unknown values are null."""
    return {
        "files": total.files,
        "failed": [{"file": a.file, "why": a.failed} for a in total.failed],
        "broken": [{"file": a.file, "why": _ends_early(a)} for a in total.broken],
        "watched_s": total.watched_s,
        "outside_labels_s": total.outside_s,
        "curves": [curve_data(one) for one in found],
        "recordings": [
            {
                "file": a.file,
                "duration_s": a.duration_s,
                "watched_s": a.watched_s,
                "first_reaction_s": a.reaction_s,
                "recorded": a.recorded,
                "contacts": a.contacts,
                "recorded_N": a.recorded_N,
                "force_N": a.force_N,
            }
            for a in total.answers
        ],
    }


def curve_data(one: Detection) -> dict[str, Any]:
    """One curve for JSON; NaN becomes null."""

    def known(point: Point) -> dict[str, Any]:
        values = asdict(point).items()
        return {name: None if value != value else value for name, value in values}  # noqa: PLR0124

    return {**asdict(one), "points": [known(point) for point in one.points]}


def _write_page(target: Path, total: Total, found: Sequence[Detection], accepted: float) -> None:
    about = (
        f"{counted(len(total.answers), 'recording', 'recordings')}, "
        f"{total.watched_s / 3600:.3g} h watched, of that "
        f"{total.outside_s / 3600:.3g} h outside of labels; acceptable: {accepted:g} per hour"
    )
    curves = {"arm": ARM, "curves": [curve_data(one) for one in found]}
    page = filled("curves", "Detection curves", about, curves)
    with whole_file(target) as partial:
        partial.write_text(page, encoding="utf-8")
