"""Measurements, each a command: `python -m bench.NAME [--json]`; `rigs` and `study` serve them."""

from compiled import refuse_stale

refuse_stale()  # a measurement is of the code that is here
