"""Golden files: what a command prints, word for word, beside its tests.

`GOLDEN=write python -m pytest FILE` writes them anew; the difference in git shows what changed.
"""

import os
from pathlib import Path


def same_words(golden: Path, printed: str) -> None:
    """Assert that a command printed what its golden file holds; trailing blanks do not count."""
    printed = "".join(f"{line.rstrip()}\n" for line in printed.splitlines())
    if os.environ.get("GOLDEN") == "write":
        golden.parent.mkdir(exist_ok=True)
        golden.write_text(printed, encoding="utf-8")
    assert printed == golden.read_text(encoding="utf-8"), "changed: see tests/golden_words.py"
