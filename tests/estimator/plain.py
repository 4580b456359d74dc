"""The estimator's compiled modules, plain and built, by name."""

from types import ModuleType

from tests import plain as modules


def plain() -> dict[str, ModuleType]:
    """Run from their sources."""
    return modules.plain("estimator")


def built() -> dict[str, ModuleType]:
    """As they are imported."""
    return modules.built("estimator")
