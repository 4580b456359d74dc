"""Build of the compiled modules: Cython translates them to C, which is compiled to extensions.

    python hatch_build.py            # build outdated ones beside their sources: `make compiled`
    python hatch_build.py --clean    # remove all extensions: everything runs as plain Python

A module is compiled if a .pxd with its types lies beside it. Without a C compiler on the machine,
the wheel `ziglang` provides one. If the build fails (e.g. without Python headers), the modules run
as plain Python, with a warning here and from `contactd run`.
"""

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))  # a build starts in another folder

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

from common import compiled

# No contraction: fused multiply-add would round differently from the plain module.
FLAGS = ("-shared", "-fPIC", "-O2", "-g0", "-ffp-contract=off", "-fwrapv", "-w")
CYTHON = "3.3.1"
SUFFIX = str(sysconfig.get_config_var("EXT_SUFFIX"))


def compiler() -> list[str]:
    """Command of the C compiler: $CC, else the machine's, else that of the wheel `ziglang`."""
    if "CC" in os.environ:
        return shlex.split(os.environ["CC"])
    found = shutil.which("gcc") or shutil.which("cc")
    if found:
        return [found]
    # By default ziglang targets the build machine's processor, and the result may fail on others.
    return [sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline"]


class CompiledModules(BuildHookInterface):  # type: ignore[type-arg]
    """Extensions for a wheel. An editable install gets none: as pip hides the output of a build,
    `make` builds them beside their sources instead, and shows failures."""

    def dependencies(self) -> list[str]:
        if self.target_name != "wheel":
            return []
        return [f"cython=={CYTHON}", *(["ziglang==0.17.1"] if "ziglang" in compiler() else [])]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if self.target_name != "wheel" or version == "editable":
            return
        root = Path(self.root)
        out, sources = root / "build" / "extensions", compiled.sources(root)
        try:
            # Use the extensions beside their sources if they are up to date.
            chosen = compiled.modules(root)
            if out_of_date(root):
                made = build(root, out, chosen)
            else:
                made, out = [root / f"{module}{SUFFIX}" for module in chosen], root
        except (OSError, subprocess.CalledProcessError) as error:
            self.app.display_warning(f"no compiled modules, they run as plain Python: {error}")
            return
        made.append(record(sources, out))
        build_data["force_include"] |= {str(so): str(so.relative_to(out)) for so in made}
        build_data["pure_python"], build_data["infer_tag"] = False, True


def build(
    root: Path, out: Path, chosen: Sequence[str], finished: Callable[[str], None] = lambda _: None
) -> list[Path]:
    """Compile these modules of `root` into the same folders of `out`, one in each process; returns
    the extensions. `finished` is called with each module, as soon as its extension is complete.
    Raises OSError or CalledProcessError on failure."""
    include = Path(sysconfig.get_path("include"))
    if not (include / "Python.h").exists():
        raise FileNotFoundError(
            f"{include}/Python.h is missing: install the headers of Python (Debian: "
            f"sudo apt install python{sys.version_info[0]}-dev)"
        )
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        running = {pool.submit(_compile, root, out, include, module): module for module in chosen}
        try:
            for future in as_completed(running):
                future.result()
                finished(running[future])
        finally:  # after a failure or Ctrl-C, no further one is begun
            pool.shutdown(wait=False, cancel_futures=True)
    return [out / f"{module}{SUFFIX}" for module in chosen]


def _compile(root: Path, out: Path, include: Path, module: str) -> None:
    c, extension = root / "build" / "c" / f"{module}.c", out / f"{module}{SUFFIX}"
    for file in (c, extension):
        file.parent.mkdir(parents=True, exist_ok=True)
    cython = [sys.executable, "-m", "cython", "-3", f"{module}.py", "-o", str(c)]
    _run(cython, root)
    # Replaced atomically: a process that runs the old extension keeps it.
    new = extension.with_suffix(".new")
    _run([*compiler(), *FLAGS, f"-I{include}", str(c), "-o", str(new)], root)
    new.replace(extension)


def _run(command: Sequence[str], folder: Path) -> None:
    done = subprocess.run(
        command,
        cwd=folder,
        check=False,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    if done.returncode != -signal.SIGINT:  # of Ctrl-C it would show a traceback
        sys.stderr.write(done.stdout)
    done.check_returncode()


def how() -> list[str]:
    """Dependencies of an extension other than its sources."""
    return [CYTHON, SUFFIX, *compiler(), *FLAGS]


def record(sources: Mapping[str, str], out: Path) -> Path:
    """Record how the extensions in `out` were built, and from what. sources: digests taken before
    the build, so that files edited meanwhile count as outdated."""
    path, new = out / compiled.RECORD, out / f"{compiled.RECORD}.new"
    new.write_text(json.dumps({"how": how(), "sources": sources}, indent=1) + "\n")
    return new.replace(path)  # whole, also after an interruption


def out_of_date(root: Path) -> list[str]:
    """Modules of `root` whose extension is missing or was built from other sources."""
    try:
        same = json.loads((root / compiled.RECORD).read_text())["how"] == how()
    except (OSError, ValueError, LookupError):
        same = False
    built = compiled.recorded(root) if same else {}
    return [
        module
        for module, digest in compiled.sources(root).items()
        if built.get(module) != digest or not (root / f"{module}{SUFFIX}").exists()
    ]


def clean(root: Path) -> None:
    """Remove all extensions: everything runs as plain Python."""
    (root / compiled.RECORD).unlink(missing_ok=True)
    for extension in compiled.extensions(root):
        extension.unlink()


def main(root: Path) -> int:
    """Build outdated extensions beside their sources. Each is recorded when it is complete, so that
    after an interruption the next run continues; on failure, all extensions are removed."""
    now = {root / f"{module}{SUFFIX}" for module in compiled.modules(root)}
    for extension in compiled.extensions(root):
        if extension not in now:
            extension.unlink()
    if not (chosen := out_of_date(root)):
        return 0
    sources = compiled.sources(root)
    done = {module: digest for module, digest in sources.items() if module not in chosen}
    progress = Progress(len(chosen))

    def finished(module: str) -> None:
        done[module] = sources[module]
        record(done, root)
        progress.step()

    try:
        build(root, root, chosen, finished)
    except KeyboardInterrupt:
        progress.end(f"interrupted; the next run compiles the other {len(sources) - len(done)}")
        return 130
    except (OSError, subprocess.CalledProcessError) as error:
        clean(root)
        progress.end(
            f"not compiled, runs as plain Python, the estimator about 50 times slower: {error}"
        )
        return 1
    progress.end()
    return 0


class Progress:
    """Progress of a build on stderr: one line that is rewritten at a terminal, else a line for each
    quarter."""

    def __init__(self, total: int) -> None:
        self._total, self._done, self._live = total, 0, sys.stderr.isatty()
        self._show(f"compiling {total} modules, a few minutes at most", stays=True)

    def step(self) -> None:
        """One more module is compiled."""
        self._done += 1
        quarters, before = (4 * done // self._total for done in (self._done, self._done - 1))
        if self._live or quarters > before:
            self._show(f"{self._done} of {self._total} modules compiled", stays=not self._live)

    def end(self, text: str = "") -> None:
        """The last line: that of the progress stays, followed by `text`."""
        if self._live and self._done:
            print(file=sys.stderr)
        if text:
            self._show(text, stays=True)

    def _show(self, text: str, *, stays: bool) -> None:
        print(f"contactd: {text}", end="\n" if stays else "\r", file=sys.stderr, flush=True)


if __name__ == "__main__":
    if sys.argv[1:] == ["--clean"]:
        clean(Path(__file__).parent)
    else:
        sys.exit(main(Path(__file__).parent))
