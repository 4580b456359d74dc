"""The build of the compiled modules where it cannot be, and what runs then."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import hatch_build
from tests.plain import COMPILED

ROOT = Path(__file__).parents[1]


@pytest.fixture
def without_headers(monkeypatch, tmp_path: Path) -> Path:
    """A tree like this one, with an extension of old, on a machine without headers of Python."""
    for name in ("estimator", "drivers", "daemon", "configs"):
        ignored = shutil.ignore_patterns("*.so", "__pycache__")
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored)
    for file in (
        "arrays.py",
        "compiled.py",
        "elementary.py",
        "elementary.pxd",
        "errors.py",
        "regular_file.py",
    ):
        shutil.copy(ROOT / file, tmp_path)
    (tmp_path / "estimator" / "kernel.cpython-00.so").write_text("older than its source")
    real = sysconfig.get_path
    fake = {"include": str(tmp_path / "include")}
    monkeypatch.setattr(sysconfig, "get_path", lambda name: fake.get(name) or real(name))
    return tmp_path


def test_it_says_in_one_line_what_to_install_and_leaves_nothing_old(
    without_headers: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert hatch_build.main(without_headers) == 1
    (line,) = capfd.readouterr().err.splitlines()
    assert "not compiled, runs as plain Python" in line
    assert f"{without_headers}/include/Python.h is missing" in line
    assert "sudo apt install python3-dev" in line
    assert not list((without_headers / "estimator").glob("*.so"))


def test_a_wheel_is_made_all_the_same(without_headers: Path) -> None:
    said: list[str] = []
    app: Any = SimpleNamespace(display_warning=said.append)
    hook = hatch_build.CompiledModules(
        str(without_headers), {}, None, None, str(without_headers), "wheel", app
    )
    data = {"force_include": {}, "pure_python": True}
    hook.initialize("standard", data)
    assert data == {"force_include": {}, "pure_python": True}
    assert ["Python.h is missing" in line for line in said] == [True]


RUN = """
import numpy as np
from daemon.assembly import build_estimator
from daemon.config.load import load_robot
from compiled import uncompiled, warning
from pathlib import Path
robot = load_robot(Path("configs/single_joint"))
estimator = build_estimator(robot.configuration, robot.urdf)
for k in range(5):
    estimate = estimator.step(*np.full((4, 1), 0.1))
print(len(uncompiled()), bool(warning()), int(estimate.flags), np.isfinite(estimate.residual).all())
"""


def test_everything_runs_as_plain_python(without_headers: Path) -> None:
    hatch_build.main(without_headers)
    done = subprocess.run(
        [sys.executable, "-c", RUN],
        cwd=without_headers,
        env={**os.environ, "PYTHONPATH": str(without_headers)},
        capture_output=True,
        text=True,
        check=True,
    )
    expected = [name for name in COMPILED if not name.startswith("simulator")]
    assert done.stdout.split() == [str(len(expected)), "True", "0", "True"]
