"""Side-by-side figures, each a command: `python -m bench.NAME [--json]`."""
