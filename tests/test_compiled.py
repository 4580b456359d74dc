"""What is compiled, what should be, and who says so."""

import sys

from compiled import uncompiled, warning
from tests.plain import COMPILED, built, plain


def test_modules_of_every_folder_are_compiled() -> None:
    folders = {name.rpartition(".")[0] for name in COMPILED}
    assert folders == {"", "daemon.faults", "daemon.motion", "drivers", "estimator", "simulator"}
    assert all(str(m.__file__).endswith(".py") for m in plain("daemon.faults").values())
    assert built("daemon.faults")["measures"] is sys.modules["daemon.faults.measures"]


def test_a_plain_module_is_named(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "estimator.dynamics", plain("estimator")["dynamics"])
    assert "estimator.dynamics" in uncompiled()
    assert "estimator.dynamics" in warning()
    assert "python3-dev" in warning()
