"""Progress of a long run, on stderr."""

from collections.abc import Callable

import click

Report = Callable[[float], None]  # Takes the share of a run that is done, 0 to 1.


class Progress:
    """A line on stderr for every tenth that is done."""

    def __init__(self, name: str) -> None:
        self._name, self._shown = name, 0

    def __call__(self, share: float) -> None:
        """Write the line if another tenth is done."""
        if share >= (self._shown + 1) / 10:
            self._shown = int(10 * share + 1e-9)
            click.echo(f"{self._name}: {10 * self._shown} % done", err=True)
