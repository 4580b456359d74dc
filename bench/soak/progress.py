"""How far a long run is."""

import click


class Progress:
    """A line on stderr for every tenth that is done."""

    def __init__(self, name: str) -> None:
        self._name, self._told = name, 0

    def __call__(self, share: float) -> None:
        """Tell, if it is time to."""
        if share >= (self._told + 1) / 10:
            self._told = int(10 * share + 1e-9)
            click.echo(f"{self._name}: {10 * self._told} % done", err=True)
