"""The compiled modules as the plain Python that they also are, side by side with the built ones."""

import importlib
import importlib.util
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

from common.compiled import modules

ROOT = Path(__file__).parents[1]
COMPILED = [module.replace("/", ".") for module in modules(ROOT)]


class _Sources:
    """Finder of the compiled modules that takes their sources."""

    def find_spec(self, name: str, path: object, target: object = None) -> ModuleSpec | None:
        if name not in COMPILED:
            return None
        file = ROOT.joinpath(*name.split(".")).with_suffix(".py")
        return importlib.util.spec_from_file_location(name, file)


def plain(folder: str) -> dict[str, ModuleType]:
    """Modules of a folder run from their sources, as is what they import; by last name."""
    as_built = {name: importlib.import_module(name) for name in COMPILED}
    finder = _Sources()
    sys.meta_path.insert(0, finder)
    try:
        for name in COMPILED:
            del sys.modules[name]
        return _by_last_name(_of(folder))
    finally:
        sys.meta_path.remove(finder)
        for name, module in as_built.items():
            sys.modules[name] = module
            parent, _, last = name.rpartition(".")
            if parent:
                setattr(sys.modules[parent], last, module)


def built(folder: str) -> dict[str, ModuleType]:
    """Modules of a folder as they are imported, by last name."""
    return _by_last_name(_of(folder))


def _of(folder: str) -> list[str]:
    return [
        name for name in COMPILED if name.startswith(f"{folder}.") or name == "common.elementary"
    ]


def _by_last_name(names: Sequence[str]) -> dict[str, ModuleType]:
    return {name.rpartition(".")[2]: importlib.import_module(name) for name in names}
