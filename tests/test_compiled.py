"""What is compiled, what should be, and who says so."""

import sys

from compiled import DAEMON, ESTIMATOR, SIMULATOR, uncompiled
from hatch_build import MODULES
from tests.plain import ROOT, plain


def test_all_that_is_built_is_looked_at_and_has_its_types() -> None:
    assert {*DAEMON, *ESTIMATOR, *SIMULATOR} == {module.replace("/", ".") for module in MODULES}
    found = [p for folder in (".", "daemon/faults", "daemon/motion", "drivers", "estimator", "simulator") for p in (ROOT / folder).glob("*.pxd")]
    assert {str(p.relative_to(ROOT).with_suffix("")) for p in found} == set(MODULES)


def test_a_plain_module_is_named(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "estimator.dynamics", plain(ESTIMATOR)["dynamics"])
    assert "estimator.dynamics" in uncompiled(ESTIMATOR)
