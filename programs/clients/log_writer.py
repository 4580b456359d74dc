"""Writer of recordings in MCAP: the channels that `log_reader` reads, with schemas for viewers."""

from typing import IO

import msgspec
from mcap.writer import Writer

from daemon.protocol.state import Snapshot, State
from programs.clients.log_reader import KINDS, PROFILE
from programs.clients.viewer_schema import viewer_schema

# Lost at most when the process is killed: 0.25 s of seven joints, 0.75 s of one, at 100 Hz. Files
# are 3 to 9 % larger than with 512 kB, at no more CPU time.
CHUNK_BYTES = 64 * 1024


class LogWriter:
    """Writer of one file, from construction to `finish`."""

    def __init__(self, stream: IO[bytes], program: str) -> None:
        self._writer = Writer(stream, chunk_size=CHUNK_BYTES)
        self._writer.start(profile=PROFILE, library=program)
        self._channels = {kind: self._channel(topic, kind) for topic, kind in KINDS.items()}

    def write(self, kind: type[Snapshot | State], data: bytes, wall_s: float) -> None:
        """Write a message, encoded, of this time of day [s]."""
        time_ns = round(wall_s * 1e9)
        self._writer.add_message(self._channels[kind], time_ns, data, time_ns)

    def finish(self) -> None:
        """Write what the end of such a file needs."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _channel(self, topic: str, kind: type) -> int:
        data = msgspec.json.encode(viewer_schema(kind))
        schema = self._writer.register_schema(f"contactd.{kind.__name__}", "jsonschema", data)
        return self._writer.register_channel(topic, "json", schema)
