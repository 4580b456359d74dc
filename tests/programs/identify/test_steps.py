"""Table of the steps: complete, and light until one of them runs."""

import subprocess
import sys

import pytest

from daemon.config.identified import ENTRIES
from programs.identify.steps import STEPS


def test_every_entry_has_a_step_that_writes_it() -> None:
    assert {*ENTRIES, "payload"} == set(STEPS)


@pytest.mark.parametrize("words", ["identify --help", "identify masses --help"])
def test_help_waits_for_no_mathematics(words: str) -> None:
    program = (
        "import sys; from programs.contactd.contactd import main\n"
        f"main({words.split()!r}, standalone_mode=False)\n"
        "heavy = {'msgspec', 'numpy', 'pinocchio', 'scipy'}\n"
        "sys.exit(str(heavy & set(sys.modules)) if heavy & set(sys.modules) else 0)"
    )
    subprocess.run([sys.executable, "-c", program], check=True, stdout=subprocess.DEVNULL)
