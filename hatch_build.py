"""Build of the compiled modules: Cython makes C of them, a C compiler makes extensions of that.

    python hatch_build.py [MODULE...]       # anew, beside their sources

Without a compiler on the machine the wheel `ziglang` is one. Where even that cannot be (no headers
of Python), the modules run as the plain Python that they are, and `contactd run` says so.
"""

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

MODULES = (
    *("elementary", "estimator/dynamics", "estimator/gap", "estimator/kernel"),
    *("simulator/links", "simulator/two_masses", "simulator/servo", "simulator/sensors"),
    "simulator/servo_periods",
    *("daemon/faults/measures", "daemon/motion/bounding", "drivers/counts"),
)
# No contraction: a fused product would round otherwise than the plain module.
FLAGS = ("-shared", "-fPIC", "-O2", "-g0", "-ffp-contract=off", "-fwrapv", "-w")


def compiler() -> list[str]:
    """$CC, or the machine's compiler, or that in the wheel `ziglang`."""
    if "CC" in os.environ:
        return shlex.split(os.environ["CC"])
    found = shutil.which("gcc") or shutil.which("cc")
    return [found] if found else [sys.executable, "-m", "ziglang", "cc"]


class CompiledModules(BuildHookInterface):  # type: ignore[type-arg]
    """Extensions beside their sources in an editable install, and in the wheel else."""

    def dependencies(self) -> list[str]:
        return ["cython==3.3.1", *(["ziglang==0.17.1"] if "ziglang" in compiler() else [])]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if self.target_name != "wheel":
            return
        root = Path(self.root)
        out = root if version == "editable" else root / "build" / "extensions"
        try:
            made = [build(root, module, out) for module in MODULES]
        except (OSError, subprocess.CalledProcessError) as error:
            self.app.display_warning(f"no compiled modules, they run as plain Python: {error}")
            return
        if version != "editable":
            build_data["force_include"] |= {str(so): str(so.relative_to(out)) for so in made}
            build_data["pure_python"], build_data["infer_tag"] = False, True


def build(root: Path, module: str, out: Path) -> Path:
    """Compile MODULE.py into the same folder below `out`. Raises OSError or CalledProcessError
    where that fails."""
    include = sysconfig.get_path("include")
    if not (Path(include) / "Python.h").exists():
        raise FileNotFoundError(f"{include}/Python.h (apt install python3-dev)")
    work = root / "build" / "c"
    c = work / f"{module}.c"
    extension = out / f"{module}{sysconfig.get_config_var('EXT_SUFFIX')}"
    for file in (c, extension):
        file.parent.mkdir(parents=True, exist_ok=True)
    cython = [sys.executable, "-m", "cython", "-3", f"{module}.py", "-o", str(c)]
    subprocess.run(cython, cwd=root, check=True)
    # Put in place whole: who runs the old one keeps it.
    new = extension.with_suffix(".new")
    subprocess.run([*compiler(), *FLAGS, f"-I{include}", str(c), "-o", str(new)], check=True)
    return new.replace(extension)


if __name__ == "__main__":
    for each in sys.argv[1:] or MODULES:
        print(build(Path(__file__).parent, each, Path(__file__).parent))
