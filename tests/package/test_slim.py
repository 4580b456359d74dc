"""Files taken out of an installed environment, and those that stay."""

import os
from pathlib import Path

import pytest

from package.slim import slim

KEPT = (
    "bin/contactd",
    "bin/contactd-web",
    "bin/python3.11",
    "lib/python3.11/site-packages/cmeel.prefix/lib/libcoal.so",
    "lib/python3.11/site-packages/cmeel.prefix/lib/libcoal.so.1",
    "lib/python3.11/site-packages/daemon/tests.py",
    "lib/python3.11/site-packages/numpy/testing/__init__.py",
    "lib/python3.11/site-packages/zstandard/backend_c.cpython-311-x86_64-linux-gnu.so",
    "pyvenv.cfg",
)
GONE = (
    "bin/pip3",
    "bin/assimp",
    "lib/python3.11/site-packages/cmeel.prefix/include/coal/coal.hh",
    "lib/python3.11/site-packages/cmeel.prefix/lib/liboctomap.a",
    "lib/python3.11/site-packages/numpy/_core/lib/libnpymath.a",
    "lib/python3.11/site-packages/numpy/ma/tests/test_it.py",
    "lib/python3.11/site-packages/numpy/tests/test_it.py",
    "lib/python3.11/site-packages/pip/__init__.py",
    "lib/python3.11/site-packages/pip-23.0.1.dist-info/METADATA",
    "lib/python3.11/site-packages/scipy/optimize/tests/test_it.py",
    "lib/python3.11/site-packages/zstandard/_cffi.cpython-311-x86_64-linux-gnu.so",
)


@pytest.fixture
def environment(tmp_path: Path) -> Path:
    for name in (*KEPT, *GONE):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("the same" if ".so" in name else name)
    return tmp_path


def test_only_what_never_runs_is_taken_out(environment: Path) -> None:
    slim(environment)
    left = {str(path.relative_to(environment)) for path in environment.rglob("*") if path.is_file()}
    assert left == set(KEPT)


def test_copies_of_one_library_share_a_place_and_others_do_not(environment: Path) -> None:
    library, copy, *_ = (environment / name for name in KEPT if ".so" in name)
    other = library.with_name("libother.so")
    other.write_text("another")
    slim(environment)
    assert os.path.samefile(library, copy)
    assert not os.path.samefile(library, other)
    assert other.read_text() == "another"


def test_a_folder_that_is_no_environment_is_left_alone(environment: Path) -> None:
    (environment / "pyvenv.cfg").unlink()
    with pytest.raises(ValueError, match="is not a virtual environment"):
        slim(environment)
    assert (environment / GONE[0]).exists()
