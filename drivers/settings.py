"""Settings of any bus: their base, and what several of them use."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

# A node id is 1 ... 127 (CiA 301); 127 is the usual place of a master, so that drives may use the
# rest.
NodeId = Annotated[int, Meta(ge=1, le=127)]
Sign = Literal[-1, 1]
Name = Annotated[str, Meta(min_length=1, max_length=64)]


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of everything that is read from a configuration file: immutable, no unknown keys."""
