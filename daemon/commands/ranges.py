"""Numbers on a command line."""

import math
from typing import Any

import click


class Range(click.FloatRange):
    """A number between bounds; nan, which passes every comparison of `FloatRange`, is none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Raises BadParameter that names value and range; click adds the option."""
        number = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"{number} is not in the range {self._describe_range()}.", param, ctx)
        return number
