"""Reports of bench commands, run as a user would."""

import json
from types import ModuleType
from typing import Any

from click.testing import CliRunner


def reported(bench: ModuleType, words: str = "") -> dict[str, Any]:
    """Report of a bench that is run with these options."""
    command = [*words.split(), "--json"]
    result = CliRunner().invoke(bench.main, command, catch_exceptions=False)
    found: dict[str, Any] = json.loads(result.stdout.splitlines()[-1])
    return found
