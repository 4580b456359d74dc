"""Writer of MCAP recordings: the channels that `log_reader` reads, with schemas for viewers."""

from typing import IO

import msgspec
from mcap.writer import Writer

from daemon.protocol.state import Snapshot, State
from programs.clients.log_reader import KINDS, PROFILE
from programs.clients.viewer_schema import viewer_schema

# If the process is killed, a chunk is lost: 0.25 s of seven joints, 0.75 s of one, at 100 Hz. Files
# are 3 to 9 % larger than with 512 kB, with equal CPU time.
CHUNK_BYTES = 64 * 1024


class LogWriter:
    """Writer of one file, from construction to `finish`."""

    def __init__(self, stream: IO[bytes], program: str) -> None:
        self._writer = Writer(stream, chunk_size=CHUNK_BYTES)
        self._writer.start(profile=PROFILE, library=program)
        self._channels = {kind: self._channel(topic, kind) for topic, kind in KINDS.items()}

    def write(self, kind: type[Snapshot | State], data: bytes, wall_s: float) -> None:
        """Write an encoded message with Unix time wall_s [s]."""
        time_ns = round(wall_s * 1e9)
        self._writer.add_message(self._channels[kind], time_ns, data, time_ns)

    def finish(self) -> None:
        """Write the footer of the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _channel(self, topic: str, kind: type) -> int:
        data = msgspec.json.encode(viewer_schema(kind))
        schema = self._writer.register_schema(f"contactd.{kind.__name__}", "jsonschema", data)
        return self._writer.register_channel(topic, "json", schema)
