"""Measured logs of others with published figures, as their owners would give them to `contactd`:
read where they lie, and written beside a configuration in a folder.
"""

import gzip
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from bench.rigs.lockstep import ROMEO, SINGLE_JOINT

_GEAR: Final = np.array([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
_ZERO: Final = np.array([0.0, -0.5, 0.5, 0.0, 0.0, 0.0]) * np.pi
_EVERY: Final = 25  # of 5 kHz
_COULOMB: Final = (7.14, 8.26, 6.34, 2.48)  # [Nm], joints 1 to 4


@dataclass(frozen=True, slots=True)
class RealLog:
    """A log, the folder of its arm or its URDF, the question, and what is true of each joint."""

    path: Path
    arm: Path
    urdf: Path | None
    asks: tuple[str, ...]
    quantity: str
    truths: dict[str, float]
    """NaN where there is nothing to find"""


def real_logs(data: Path, folder: Path) -> Iterator[RealLog]:
    """Logs of a folder of data, those that are there."""
    for name, alpha in (("base_runin1", 0.0325), ("split_3pre1", np.nan)):
        packed = data / "cycloid" / f"{name}.csv.gz"
        if packed.exists():
            log, arm = folder / f"{name}.csv", folder / name
            log.write_bytes(gzip.decompress(packed.read_bytes()))
            log.with_suffix(".yaml").write_text(
                "time: {column: TIME}\nrows: {column: test_nr, least: 100}\njoints: {joint: {"
                "link_position: {value: 0}, motor_position: {column: POSITION, unit: turn}, "
                "torque: {column: TORQUE}}}\n"
            )
            shutil.copytree(SINGLE_JOINT, arm)
            shutil.copytree(ROMEO, folder / ROMEO.name, dirs_exist_ok=True)  # its EDS
            yield RealLog(log, arm, None, ("gap", "joint"), "gap", {"joint": alpha})
    if (data / "tx40").exists():
        yield _tx40(data / "tx40", folder)


def _tx40(data: Path, folder: Path) -> RealLog:
    q, current = (np.loadtxt(data / f"{name}.csv.gz", delimiter=",", skiprows=1)[::_EVERY]
                  for name in ("pos_read_data", "curr_data"))  # fmt: skip
    time_s, log, urdf = (
        np.arange(len(q)) * _EVERY / 5000.0,
        folder / "tx40.csv",
        folder / "tx40.urdf",
    )
    names = [f"{kind}{i}" for kind in ("pos", "cur") for i in range(1, 7)]
    np.savetxt(log, np.column_stack([time_s, q, current]), delimiter=",", comments="",
               header=",".join(["time", *names]))  # fmt: skip
    lines = [
        f"  joint_{i + 1}: {{link_position: {{column: pos{i + 1}, scale: {1.0 / n}, offset: "
        f"{_ZERO[i]}}}, torque: {{column: cur{i + 1}, scale: {n}}}}}"
        for i, n in enumerate(_GEAR)
    ]
    log.with_suffix(".yaml").write_text("\n".join(["joints:", *lines, ""]))
    text = (data / "tx40.urdf").read_text()
    begin = text.rindex("<inertia ")  # rounded to zero
    body = '<inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"'
    urdf.write_text(text[:begin] + body + text[text.index("/>", begin) :])
    truths = {f"joint_{i}": c for i, c in enumerate(_COULOMB, start=1)}
    asks = ("friction", "--shortest", "8")
    return RealLog(log, folder / "tx40", urdf, asks, "friction", truths)
