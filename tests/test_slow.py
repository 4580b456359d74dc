"""The list of slow tests names tests that exist."""

import ast
from pathlib import Path

from tests.slow import listed, slow

ROOT = Path(__file__).parents[1]


def test_every_listed_test_exists() -> None:
    functions = {
        f"{path.relative_to(ROOT)}::{node.name}"
        for path in (ROOT / "tests").rglob("test_*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    assert listed() - functions == set(), "renamed or removed: correct tests/slow.txt"
    assert listed(), "an empty list would make every test a fast one"


def test_a_function_is_slow_by_the_sum_of_its_cases() -> None:
    report = """
    1.50s call     tests/a/test_b.py::test_two[one 1-x]
    0.30s setup    tests/a/test_b.py::test_two[two]
    0.30s teardown tests/a/test_b.py::test_two
    1.90s call     tests/a/test_b.py::test_one
    2.00s call     tests/a/test_c.py::test_one
    not a duration
    """
    names = ["tests/a/test_b.py::test_two", "tests/a/test_c.py::test_one"]
    assert slow(report.splitlines()) == names
