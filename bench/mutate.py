"""Every mutant of a Python file, by mutmut: one JSON list on stdout. For mutmut's own environment.

build/mutants/venv/bin/python bench/mutate.py FILE
"""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

from mutmut import Context, list_mutations, mutate, mutations_by_type

LEFT_ALONE = {"string", "fstring", "decorator"}  # Words; and whether a dataclass is frozen


def main(path: Path) -> None:
    """Print {was, became, source} of each; the first two are the changed line without its ends."""
    config = SimpleNamespace(
        mutation_types_to_apply=set(mutations_by_type) - LEFT_ALONE, covered_lines_by_filename=None
    )
    source = path.read_text()
    lines, mutants = source.splitlines(), []
    for number in list_mutations(Context(source=source, filename=str(path), config=config)):
        context = Context(source=source, filename=str(path), config=config, mutation_id=number)
        mutated, _ = mutate(context)
        was, became = next(
            pair for pair in zip(lines, mutated.splitlines(), strict=True) if pair[0] != pair[1]
        )
        mutants.append({"was": was.strip(), "became": became.strip(), "source": mutated})
    json.dump(mutants, sys.stdout)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
