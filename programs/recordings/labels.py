"""Labels: times and joints of touches in recordings, as a CSV file.

    file,start_s,end_s,joint
    touch.mcap,8.30,11.20,any

`start_s` and `end_s` count from the recording's first State; `joint` is a name, or `any`. For a
single recording, `file` may be left out.
"""

import csv
import math
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Final

import msgspec

from common.errors import LogError
from common.regular_file import open_text
from daemon.protocol.text import printable
from programs.recordings.contents import Contents

ANY: Final = "any"
_NEEDED: Final = ("start_s", "end_s", "joint")
PROPOSED_BEFORE_S: Final = 0.2
"""Time by which a touch is assumed to precede its contact, for proposed labels."""
_APART_S: Final = 0.5  # contacts closer than this are one touch


class Label(msgspec.Struct, frozen=True):
    """One labelled touch."""

    start_s: float
    end_s: float
    joint: str


Labels = dict[str, list[Label]]
"""Labels by the recording's name in the CSV file; "" without a `file` column."""


def read_labels(path: Path) -> Labels:
    """Labels of a CSV file. Raises LogError that names line and field."""
    found: Labels = {}
    try:
        with open_text(path, newline="") as stream:
            rows = csv.DictReader(stream)
            header = [name.strip() for name in rows.fieldnames or ()]
            rows.fieldnames = header
            if missing := [name for name in _NEEDED if name not in header]:
                raise LogError(f"{path}: no column {', '.join(missing)}")
            for row in rows:
                label = _label(f"{path}:{rows.line_num}", row)
                found.setdefault((row.get("file") or "").strip(), []).append(label)
    except csv.Error as error:
        raise LogError(f"{path}: is not CSV: {error}") from error
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"cannot read {path}: {error}") from error
    if not found:
        raise LogError(f"{path}: it contains no labels")
    return found


def _label(where: str, row: dict[str, str | None]) -> Label:
    times = []
    for name in ("start_s", "end_s"):
        try:
            value = float(row[name] or "")
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and value >= 0.0):
            given = printable(row[name] or "")[:40]
            raise LogError(
                f"{where}: {name} is {given!r}: must be seconds from the beginning, >= 0"
            )
        times.append(value)
    if times[0] >= times[1]:
        raise LogError(f"{where}: start_s {times[0]:g} is not before end_s {times[1]:g}")
    if not (joint := (row["joint"] or "").strip()):
        raise LogError(f"{where}: joint is empty: must be a joint's name, or {ANY}")
    return Label(times[0], times[1], joint)


def labels_of(labels: Labels, path: Path, *, alone: bool) -> list[Label]:
    """Labels of a recording, found by its path as given or its name; if it is `alone`, also labels
    without a file."""
    found = labels.get(str(path)) or labels.get(path.name) or []
    return [*found, *(labels.get("", []) if alone else [])]


def proposed(contents: Contents, name: str) -> list[tuple[str, float, float, str]]:
    """Rows of a template: the contacts of a recording, overlapping ones merged, with the joint of
    the highest ratio of peak to threshold."""
    touches: list[tuple[float, float, float, str]] = []
    for one in sorted(contents.contacts, key=lambda contact: contact.time_s):
        begin = max(one.time_s - PROPOSED_BEFORE_S, 0.0)
        lasts = contents.duration_s - one.time_s if one.duration_s is None else one.duration_s
        end, clear = one.time_s + lasts, one.clear
        if touches and begin < touches[-1][1] + _APART_S:
            first, last, most, joint = touches[-1]
            joint = one.joint if clear > most else joint
            touches[-1] = (first, max(last, end), max(most, clear), joint)
        else:
            touches.append((begin, end, clear, one.joint))
    return [(name, round(begin, 2), round(end, 2), joint) for begin, end, _, joint in touches]


def template(rows: Sequence[tuple[str, float, float, str]]) -> str:
    """Text of a CSV file with these rows."""
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("file", *_NEEDED))
    writer.writerows(rows)
    return text.getvalue()
