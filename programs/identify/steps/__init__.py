"""Steps of the identification, a module each, with the name of its command and its entry."""

from importlib import import_module
from pathlib import Path
from typing import Final

from programs.identify.step import Step

_FOUND: Final[list[Step]] = [
    getattr(import_module(f"{__name__}.{path.stem}"), path.stem)
    for path in Path(__file__).parent.glob("[a-z]*.py")
]
STEPS: Final[dict[str, Step]] = {
    step.name: step for step in sorted(_FOUND, key=lambda step: step.order)
}
"""Steps by name, in the order of their use."""
