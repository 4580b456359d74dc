"""Base of all bus and drive settings, and the types that they share."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

# A node ID is 1 ... 127 (CiA 301); 127 is usually the master's and leaves the rest to the drives.
NodeId = Annotated[int, Meta(ge=1, le=127)]
Sign = Literal[-1, 1]
# Units of bounds, which an error names after a bound.
RAD, RAD_S, RAD_S2 = ({"unit": unit} for unit in ("rad", "rad/s", "rad/s2"))
Name = Annotated[str, Meta(min_length=1, max_length=64)]


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all settings read from a configuration file: immutable, no unknown keys."""
