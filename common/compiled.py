"""Compiled modules (decision 0037): the list of them, and the check for stale extensions.

A module is compiled if a .pxd file with its types lies beside it. The build records the digests of
its sources. `python -m common.compiled` prints what is wrong, and nothing if all is well.
"""

import hashlib
import importlib
import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path

from common.errors import ProgramError

ROOT = Path(__file__).parents[1]
PACKAGES = ("common", "daemon", "drivers", "estimator", "simulator")
RECORD = "compiled.json"
_CIMPORT = re.compile(r"^from ([\w.]+) cimport ", re.MULTILINE)


def modules(root: Path = ROOT) -> list[str]:
    """Paths of the modules to compile, relative to `root` and without suffix."""
    folders = [root / name for name in PACKAGES]
    types = [p for folder in folders for p in folder.rglob("*.pxd")]
    return sorted(str(path.relative_to(root).with_suffix("")) for path in types)


def sources(root: Path = ROOT) -> dict[str, str]:
    """Digest by module of its source and of all type declarations that its extension uses."""
    types = {name: (root / f"{name}.pxd").read_text() for name in modules(root)}
    known = {name: _cimported(name, types) for name in types}
    return {
        name: hashlib.sha256(
            "\0".join([types[one] for one in sorted(known[name])]).encode()
            + (root / f"{name}.py").read_bytes()
        ).hexdigest()
        for name in types
    }


def _cimported(name: str, types: Mapping[str, str]) -> set[str]:
    """The module and all that it cimports, directly or not; `types` is the text of each .pxd."""
    found, new = {name}, [name]
    while new:
        used = {one.replace(".", "/") for one in _CIMPORT.findall(types[new.pop()])}
        used = (used & types.keys()) - found
        found |= used
        new += used
    return found


def extensions(root: Path = ROOT) -> list[Path]:
    """Existing extensions, including those whose modules are no longer compiled."""
    folders = [root / name for name in PACKAGES]
    return sorted(p for folder in folders for p in folder.rglob("*.so"))


def recorded(root: Path = ROOT) -> dict[str, str]:
    """Digests of the sources at the last build, by module; empty without a record."""
    try:
        built = json.loads((root / RECORD).read_text())["sources"]
    except (OSError, ValueError, LookupError):
        return {}
    return dict(built)


def stale(root: Path = ROOT) -> list[str]:
    """Stale extensions, and modules that lack one although others have theirs; paths without
    suffix. Empty if nothing is compiled."""
    found = {str(path.relative_to(root)).split(".")[0] for path in extensions(root)}
    if not found:
        return []
    built, now = recorded(root), sources(root)
    return sorted(
        name
        for name in found | now.keys()
        if name not in found or name not in now or built.get(name) != now[name]
    )


def refuse_stale(root: Path = ROOT) -> None:
    """Raise ProgramError if an extension does not match its source."""
    if wrong := stale(root):
        others = f" and {len(wrong) - 1} others" if len(wrong) > 1 else ""
        raise ProgramError(
            f"{wrong[0]}{others}: not compiled from the present source, or the build was "
            "interrupted; run `make compiled` (a service: `make install`), or run uncompiled after "
            "`python hatch_build.py --clean`"
        )


def uncompiled() -> list[str]:
    """Loaded modules that have a .pxd but run from their Python source."""
    ours = [(n, m.__file__) for n, m in sys.modules.items() if n.partition(".")[0] in PACKAGES]
    files = [(name, Path(file)) for name, file in ours if file and file.endswith(".py")]
    return sorted(name for name, file in files if file.with_suffix(".pxd").exists())


def warning() -> str:
    """Warning to the user about loaded modules that are not compiled; empty if there are none."""
    plain = uncompiled()
    if not plain:
        return ""
    return (
        f"not compiled, a tick takes far longer: {', '.join(plain)} (`make compiled` shows why, "
        "most often Python's headers, Debian: python3-dev; then, for a service, `make install`)"
    )


if __name__ == "__main__":
    refuse_stale()
    for name in modules():
        importlib.import_module(name.replace("/", "."))

    if text := warning():
        print(f"contactd: {text}")
