"""The compiled modules as the plain Python that they also are, side by side with the built ones."""

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from estimator.compiled import MODULES

FOLDER = Path(__file__).parents[2] / "estimator"


def plain() -> dict[str, ModuleType]:
    """The modules run from their sources, each on the plain ones before it."""
    names = [f"estimator.{name}" for name in MODULES]
    built = {name: importlib.import_module(name) for name in names}
    try:
        for name, file in zip(names, MODULES, strict=True):
            spec = importlib.util.spec_from_file_location(name, FOLDER / f"{file}.py")
            assert spec is not None
            assert spec.loader is not None
            sys.modules[name] = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(sys.modules[name])
        return {file: sys.modules[name] for name, file in zip(names, MODULES, strict=True)}
    finally:
        sys.modules.update(built)


def built() -> dict[str, ModuleType]:
    return {file: importlib.import_module(f"estimator.{file}") for file in MODULES}
