"""Build of the compiled modules: Cython makes C of them, a C compiler makes extensions of that.

    python hatch_build.py       # anew, beside their sources; `make` does it where one has changed

A module is compiled if a .pxd with its types lies beside it. Without a compiler on the machine the
wheel `ziglang` is one. Where even that cannot be (no headers of Python), the modules run as the
plain Python that they are; this says so, as does `contactd run`.
"""

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDERS = ("daemon", "drivers", "estimator", "simulator")
# No contraction: a fused product would round otherwise than the plain module.
FLAGS = ("-shared", "-fPIC", "-O2", "-g0", "-ffp-contract=off", "-fwrapv", "-w")
# The machine that it is built on; that of the Python that runs it elsewhere.
SUFFIX = str(sysconfig.get_config_var("EXT_SUFFIX"))


def modules(root: Path) -> list[str]:
    """Paths of the modules to compile, below `root` and without suffix."""
    types = [*root.glob("*.pxd"), *(p for f in FOLDERS for p in (root / f).rglob("*.pxd"))]
    return sorted(str(path.relative_to(root).with_suffix("")) for path in types)


def compiler() -> list[str]:
    """$CC, or the machine's compiler, or that in the wheel `ziglang`."""
    if "CC" in os.environ:
        return shlex.split(os.environ["CC"])
    found = shutil.which("gcc") or shutil.which("cc")
    return [found] if found else [sys.executable, "-m", "ziglang", "cc"]


class CompiledModules(BuildHookInterface):  # type: ignore[type-arg]
    """Extensions in a wheel. An editable install gets none: pip hides what a build says, so that
    `make` builds them beside their sources, and is heard where it cannot."""

    def dependencies(self) -> list[str]:
        if self.target_name != "wheel":
            return []
        return ["cython==3.3.1", *(["ziglang==0.17.1"] if "ziglang" in compiler() else [])]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if self.target_name != "wheel" or version == "editable":
            return
        root = Path(self.root)
        out = root / "build" / "extensions"
        try:
            made = build(root, out)
        except (OSError, subprocess.CalledProcessError) as error:
            self.app.display_warning(f"no compiled modules, they run as plain Python: {error}")
            return
        build_data["force_include"] |= {str(so): str(so.relative_to(out)) for so in made}
        build_data["pure_python"], build_data["infer_tag"] = False, True


def build(root: Path, out: Path) -> list[Path]:
    """Compile all modules of `root` into the same folders of `out`, and return what is made. Raises
    OSError or CalledProcessError where that fails."""
    include = Path(sysconfig.get_path("include"))
    if not (include / "Python.h").exists():
        raise FileNotFoundError(
            f"{include}/Python.h is missing: install the headers of Python (Debian: "
            f"sudo apt install python{sys.version_info[0]}-dev)"
        )
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(partial(_compile, root, out, include), modules(root)))


def _compile(root: Path, out: Path, include: Path, module: str) -> Path:
    c, extension = root / "build" / "c" / f"{module}.c", out / f"{module}{SUFFIX}"
    for file in (c, extension):
        file.parent.mkdir(parents=True, exist_ok=True)
    cython = [sys.executable, "-m", "cython", "-3", f"{module}.py", "-o", str(c)]
    subprocess.run(cython, cwd=root, check=True)
    # Put in place whole: who runs the old one keeps it.
    new = extension.with_suffix(".new")
    subprocess.run([*compiler(), *FLAGS, f"-I{include}", str(c), "-o", str(new)], check=True)
    return new.replace(extension)


def main(root: Path) -> int:
    """Build beside the sources; where that fails, take away what is older than they may be."""
    try:
        build(root, root)
    except (OSError, subprocess.CalledProcessError) as error:
        for module in modules(root):
            for extension in root.glob(f"{module}.*.so"):
                extension.unlink()
        print(
            f"contactd: not compiled, runs as plain Python, some 50 times slower: {error}",
            file=sys.stderr,
        )
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(__file__).parent))
