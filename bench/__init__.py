"""Measurements, each a command: `python -m bench.NAME [--json]`; `rigs` and `study` serve them."""

from common.compiled import refuse_stale
from common.numeric_threads import single_threaded

refuse_stale()  # a measurement is of the code that is here
single_threaded()  # before anything loads numpy
