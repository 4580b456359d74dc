"""Day record: the gears of one arm on one day (UTC), in a file of its own.

Sums are stored instead of means, so that a day can be continued after a restart. Files are written
atomically, by renaming; damaged ones are set aside and reported. Records of future days, which
result from a wrong clock, stay but are ignored.
"""

import contextlib
import math
import os
import re
import tempfile
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

from common.errors import LogError
from common.regular_file import read_text

DAYS_KEPT: Final = 800
_NAME: Final = re.compile(r"^\d{4}-\d\d-\d\d\.json$")
_DAMAGED: Final = ".damaged"
# Bounds of a file's values: larger sums are impossible for a day, and squares must stay finite.
_Amount = Annotated[float, Meta(ge=0.0, le=1e15)]
_Total = Annotated[float, Meta(ge=-1e15, le=1e15)]


class Sum(msgspec.Struct, forbid_unknown_fields=True):
    """Weighted sums of a quantity, from which mean and spread follow."""

    weight: _Amount = 0.0
    first: _Total = 0.0
    second: _Amount = 0.0

    def put(self, value: float, weight: float = 1.0) -> None:
        """Add a value, unless it is not finite."""
        if math.isfinite(value) and weight > 0.0:
            self.weight += weight
            self.first += weight * value
            self.second += weight * value * value

    @property
    def mean(self) -> float:
        """Mean; NaN without a value."""
        return self.first / self.weight if self.weight > 0.0 else math.nan


class JointDay(msgspec.Struct, forbid_unknown_fields=True):
    """One joint on one day. Weights: seconds in motion; for gap and skew, two-minute intervals."""

    moved_s: _Amount = 0.0
    friction: Sum = msgspec.field(default_factory=Sum)  # learned, over that of the configuration
    half_gap: Sum = msgspec.field(default_factory=Sum)  # from crossings of the gap [rad]
    skew_ms: Sum = msgspec.field(default_factory=Sum)  # delay of link encoder behind the motor's
    forth: Sum = msgspec.field(default_factory=Sum)  # residual at positive velocity [Nm]
    back: Sum = msgspec.field(default_factory=Sum)  # residual at negative velocity [Nm]
    bound_s: _Amount = 0.0  # time in motion with learned friction at its bound

    @property
    def remainder(self) -> float:
        """Remainder of gravity: the part of the residual that does not change sign with the motion
        [Nm]; NaN unless the joint moved in both directions."""
        return 0.5 * (self.forth.mean + self.back.mean)


class Day(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """One arm on one day."""

    version: Literal[1] = 1
    arm: str
    date: str  # UTC, 2026-11-23
    identified: dict[str, str] = {}  # date of friction or gap in identified.yaml, by joint
    joints: dict[str, JointDay] = msgspec.field(default_factory=dict)


def continued_day(day: Day, identified: dict[str, str]) -> Day:
    """Day to be continued with the present identification, without the sums of joints that were
    identified since, which refer to another friction and gap."""
    same = {
        name: joint
        for name, joint in day.joints.items()
        if day.identified.get(name) == identified.get(name)
    }
    return msgspec.structs.replace(day, identified=dict(identified), joints=same)


@dataclass(frozen=True, slots=True)
class Days:
    """Days of an arm in order; damaged files; and reasons why others were ignored."""

    days: tuple[Day, ...]
    damaged: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def words(self) -> list[str]:
        """Warnings about the files, one line each."""
        return [*(f"damaged record: {name}" for name in self.damaged), *self.left_out]


def read_day(path: Path) -> Day | None:
    """Record in a file; None if it is invalid. Raises OSError if it cannot be opened."""
    try:
        day = msgspec.json.decode(read_text(path), type=Day)
    except (msgspec.DecodeError, UnicodeDecodeError, ValueError):
        return None
    return day if f"{day.date}.json" == path.name and _is_date(day.date) else None


def _is_date(iso: str) -> bool:
    try:
        date.fromisoformat(iso)
    except ValueError:  # e.g. the 31st of June
        return False
    return True


def today() -> str:
    """Present date (UTC)."""
    return datetime.now(UTC).date().isoformat()


def read_days(folder: Path, *, until: str, set_aside: bool = False) -> Days:
    """All records of a folder up to the day `until`; set_aside: rename damaged ones. Raises
    LogError if the folder cannot be read; a missing folder has no records."""
    days, damaged, left_out = [], [], []
    try:
        names = sorted(os.listdir(folder))
    except FileNotFoundError:
        return Days(())
    except OSError as error:
        raise LogError(f"{folder}: {error.strerror}") from error
    for name in names:
        path = folder / name
        if name.endswith(_DAMAGED):
            damaged.append(str(path))
        elif _NAME.match(name):
            try:
                day = read_day(path)
                if day is None:
                    damaged.append(str(aside(path) if set_aside else path))
                elif day.date > until:
                    left_out.append(f"record of a future day (is the clock right?): {path}")
                else:
                    days.append(day)
            except OSError as error:
                left_out.append(f"record cannot be read: {path}: {error.strerror}")
    return Days(tuple(days), tuple(damaged), tuple(left_out))


def aside(path: Path) -> Path:
    """Rename a damaged file; returns the new path."""
    for k in range(100):
        other = path.with_name(f"{path.name}{f'.{k}' if k else ''}{_DAMAGED}")
        if not other.exists():
            path.rename(other)
            return other
    path.unlink()
    return path


def write_day(folder: Path, day: Day) -> None:
    """Write a record atomically, and delete records beyond DAYS_KEPT. Raises LogError."""
    path = folder / f"{day.date}.json"
    partial = ""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, prefix=".", delete=False) as stream:
            partial = stream.name
            stream.write(msgspec.json.encode(day))
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(partial, 0o640)
        os.replace(partial, path)
        kept = sorted(name for name in os.listdir(folder) if _NAME.match(name))
        for old in kept[:-DAYS_KEPT]:
            (folder / old).unlink(missing_ok=True)
    except OSError as error:
        with contextlib.suppress(OSError):
            os.unlink(partial)
        raise LogError(f"{path}: {error.strerror}") from error
