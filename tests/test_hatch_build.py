"""The build of the compiled modules where it cannot be, and what runs then."""

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import hatch_build
from common.compiled import RECORD, extensions, modules, refuse_stale, sources, stale
from common.errors import ProgramError
from tests.plain import COMPILED

ROOT = Path(__file__).parents[1]


@pytest.fixture
def without_headers(monkeypatch, tmp_path: Path) -> Path:
    """A tree like this one, with an extension of old, on a machine without headers of Python."""
    for name in ("common", "estimator", "drivers", "daemon", "configs"):
        ignored = shutil.ignore_patterns("*.so", "__pycache__")
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored)
    (tmp_path / "estimator" / "kernel.cpython-00.so").write_text("older than its source")
    real = sysconfig.get_path
    fake = {"include": str(tmp_path / "include")}
    monkeypatch.setattr(sysconfig, "get_path", lambda name: fake.get(name) or real(name))
    return tmp_path


def test_it_says_in_one_line_what_to_install_and_leaves_nothing_old(
    without_headers: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert hatch_build.main(without_headers) == 1
    first, line = capfd.readouterr().err.splitlines()
    assert "compiling" in first
    assert "not compiled, runs as plain Python" in line
    assert f"{without_headers}/include/Python.h is missing" in line
    assert "sudo apt install python3-dev" in line
    assert not list((without_headers / "estimator").glob("*.so"))
    assert stale(without_headers) == []
    assert hatch_build.out_of_date(without_headers) == modules(without_headers)


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


def built(root: Path) -> Path:
    """A tree whose extensions are built, as far as their files tell."""
    hatch_build.clean(root)
    for module in modules(root):
        (root / f"{module}{hatch_build.SUFFIX}").write_text("built")
    hatch_build.record(sources(root), root)
    return root


def put_headers(root: Path) -> None:
    (root / "include").mkdir()
    (root / "include" / "Python.h").touch()


def edit(root: Path) -> None:
    with (root / "estimator" / "residual.py").open("a") as file:
        file.write("# edited")
    os.utime(root / "estimator" / "residual.py", (1.0, 1.0))  # as an archive unpacks it


def retype(root: Path) -> None:
    with (root / "estimator" / "residual.pxd").open("a") as file:
        file.write("# other types")


WRONG: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "an edited source, old by its time": (edit, ("estimator/residual",)),
    "types of which others are made": (retype, ("estimator/adaptation", "estimator/kernel")),
    "a module that is compiled no more": (
        lambda root: (root / "drivers" / "counts.pxd").unlink(), ("drivers/counts",),
    ),
    "one missing beside others": (
        lambda root: (root / f"common/elementary{hatch_build.SUFFIX}").unlink(),
        ("common/elementary",),
    ),
    "no record": (lambda root: (root / RECORD).unlink(), ("common/elementary", "estimator/kernel")),
    "a damaged record": (lambda root: (root / RECORD).write_text("{}"), ("common/elementary",)),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_an_extension_of_another_source_is_refused(without_headers: Path, wrong: str) -> None:
    root = built(without_headers)
    assert stale(root) == hatch_build.out_of_date(root) == []
    refuse_stale(root)
    spoil, named = WRONG[wrong]
    spoil(root)
    assert set(named) <= set(stale(root))
    with pytest.raises(ProgramError, match=rf"{named[0]}.*make compiled"):
        refuse_stale(root)


def test_types_that_a_module_does_not_know_leave_it_alone(without_headers: Path) -> None:
    root = built(without_headers)
    retype(root)
    assert not {"common/elementary", "estimator/wrench", "simulator/gears"} & set(stale(root))


def test_the_build_takes_away_what_is_compiled_no_more(without_headers: Path) -> None:
    root = built(without_headers)
    (root / "drivers" / "counts.pxd").unlink()
    hatch_build.main(root)
    assert not any("counts" in file.name for file in extensions(root))


def test_what_is_edited_while_it_is_compiled_is_stale(without_headers: Path, monkeypatch) -> None:
    root = built(without_headers)
    retype(root)
    put_headers(root)
    monkeypatch.setattr(hatch_build, "_compile", lambda *_: edit(root))
    assert hatch_build.main(root) == 0
    assert stale(root) == hatch_build.out_of_date(root) == ["estimator/residual"]


@pytest.mark.parametrize("live", [False, True])
def test_a_run_after_an_interruption_compiles_the_rest(
    without_headers: Path, monkeypatch, capsys, live: bool
) -> None:
    root, made = built(without_headers), list[str]()
    put_headers(root)
    (root / RECORD).unlink()
    monkeypatch.setattr(sys.stderr, "isatty", lambda: live, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)

    def compile_one(*arguments: Any) -> None:
        made.append(arguments[-1])
        if len(made) == 9:
            raise KeyboardInterrupt

    monkeypatch.setattr(hatch_build, "_compile", compile_one)
    assert hatch_build.main(root) == 130
    left = modules(root)[8:]
    assert hatch_build.out_of_date(root) == left
    assert f"interrupted; the next run compiles the other {len(left)}" in capsys.readouterr().err
    made[:] = [""] * 9
    assert hatch_build.main(root) == 0
    assert (made[9:], hatch_build.out_of_date(root)) == (left, [])
    said, last = capsys.readouterr().err, f"{len(left)} of {len(left)} modules compiled"
    assert said.endswith(f"contactd: {last}" + "\r" * live + "\n")
    assert said.count("\n") == (2 if live else 5)


def test_another_compiler_builds_all_anew(without_headers: Path, monkeypatch) -> None:
    root = built(without_headers)
    monkeypatch.setenv("CC", "another-cc")
    assert stale(root) == []
    assert hatch_build.out_of_date(root) == modules(root)


def test_ziglang_builds_for_every_processor_of_the_architecture(monkeypatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    assert hatch_build.compiler()[1:] == ["-m", "ziglang", "cc", "-mcpu=baseline"]


RUN = """
import numpy as np
from daemon.assembly import build_estimator
from daemon.config.load import load_robot
from common.compiled import uncompiled, warning
from pathlib import Path
robot = load_robot(Path("configs/single_joint"))
estimator = build_estimator(robot.configuration, robot.model)
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
