"""Paths on a command line."""

from pathlib import Path
from typing import Final

import click

# Left to click, a file that may not be read ends in a message and an exit status of its own.
# Whoever opens it knows what it was for.
PATH: Final = click.Path(path_type=Path, readable=False)
