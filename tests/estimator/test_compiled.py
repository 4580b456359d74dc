"""What is compiled, what should be, and who says so."""

import sys

from estimator.compiled import MODULES, uncompiled, warning
from hatch_build import MODULES as BUILT
from tests.estimator.plain import FOLDER, plain


def test_all_that_is_built_is_looked_at_and_has_its_types() -> None:
    assert MODULES == BUILT
    assert {p.stem for p in FOLDER.glob("*.pxd")} == set(MODULES)


def test_a_plain_module_is_named(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "estimator.dynamics", plain()["dynamics"])
    assert "estimator.dynamics" in uncompiled()
    assert "estimator.dynamics" in warning()
    assert "python3-dev" in warning()
