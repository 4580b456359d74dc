"""The compiled modules as the plain Python that they also are, side by side with the built ones."""

import importlib
import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[1]


def plain(names: Sequence[str]) -> dict[str, ModuleType]:
    """These modules run from their sources, each on the plain ones before it; by last name."""
    as_built = built(names)
    try:
        for name in names:
            file = ROOT.joinpath(*name.split(".")).with_suffix(".py")
            spec = importlib.util.spec_from_file_location(name, file)
            assert spec is not None
            assert spec.loader is not None
            sys.modules[name] = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(sys.modules[name])
        return {name.split(".")[-1]: sys.modules[name] for name in names}
    finally:
        sys.modules.update({module.__name__: module for module in as_built.values()})


def built(names: Sequence[str]) -> dict[str, ModuleType]:
    """These modules as they are imported, by last name."""
    return {name.split(".")[-1]: importlib.import_module(name) for name in names}
