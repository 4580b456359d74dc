"""Measurements, each a command: `python -m bench.NAME [--json]`; `rigs` and `study` serve them."""
