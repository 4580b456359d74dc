"""Internal state as plain lists and back, so that a recording replays bit-identically.

An owner names the attributes that make up its state. Arrays are kept in place, which lets other
objects hold views of them.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from errors import ModelError


def dump(owner: object, names: Sequence[str]) -> dict[str, Any]:
    """Copies of the named attributes: arrays as nested lists, scalars as they are."""
    values = ((name, getattr(owner, name)) for name in names)
    return {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in values}


def load(owner: object, names: Sequence[str], memory: Mapping[str, Any], what: str = "") -> None:
    """Put `dump`'s values back. Raises ModelError where names, shapes or numbers do not fit."""
    what = what or type(owner).__name__
    if set(memory) != set(names):
        raise ModelError(f"memory of {what}: fields {sorted(memory)}, expected {sorted(names)}")
    for name in names:
        old = getattr(owner, name)
        try:
            new = np.array(memory[name], dtype=np.asarray(old).dtype)
        except (TypeError, ValueError, OverflowError) as error:
            raise ModelError(f"memory of {what}.{name}: {error}") from error
        if new.shape != np.shape(old):
            raise ModelError(f"memory of {what}.{name}: shape {new.shape}, not {np.shape(old)}")
        if not np.all(np.isfinite(new)):
            raise ModelError(f"memory of {what}.{name}: not finite")
        if isinstance(old, np.ndarray):
            old[...] = new
        else:
            setattr(owner, name, type(old)(new))
