"""Upload of one trajectory by a client, chunk by chunk, before it is started."""

from collections.abc import Sequence

from common.errors import ControlError
from daemon.motion.limits import Limits
from daemon.motion.sampled_path import PathBuilder, SampledPath
from daemon.protocol.requests import Header


class TrajectoryUpload:
    """Buffer for one trajectory, which belongs to the connection that began it. A connection that
    begins another replaces it: an unfinished upload does not block other clients."""

    def __init__(self, joints: Sequence[str], limits: Limits, ramp_s: float) -> None:
        self._joints, self._limits, self._ramp_s = tuple(joints), limits, ramp_s
        self._owner = 0
        self._builder: PathBuilder | None = None
        self._path: SampledPath | None = None

    def begin(self, header: Header, owner: int) -> None:
        """Begin a trajectory of the connection `owner`, in place of any other. Raises
        TrajectoryError."""
        builder = PathBuilder(
            header.name,
            self._joints,
            header.joints,
            self._limits,
            self._ramp_s,
            from_here=header.from_here,
            motors_only=header.motors_only,
        )
        self.release(self._owner)
        self._owner, self._builder = owner, builder

    def append(self, rows: Sequence[Sequence[float]], owner: int) -> int:
        """Add rows; returns their number so far. Raises TrajectoryError for a row beyond a limit,
        and forgets the whole trajectory; ControlError if there is none to add to."""
        builder = self._of(owner)
        if self._path is not None:
            raise ControlError("this trajectory is complete: begin another with a header")
        try:
            builder.append(rows)
        except Exception:
            self.release(owner)
            raise
        return builder.rows

    def take(self, owner: int) -> SampledPath:
        """Complete trajectory. Raises TrajectoryError if it is too short, ControlError if this
        connection has loaded none."""
        builder = self._of(owner)
        if self._path is None:
            self._path = builder.finish()
        return self._path

    def release(self, owner: int) -> None:
        """Discard the trajectory of this connection; if it runs already, it continues."""
        if owner == self._owner:
            self._owner, self._builder, self._path = 0, None, None

    def _of(self, owner: int) -> PathBuilder:
        if self._builder is None or owner != self._owner:
            raise ControlError(
                "this connection has loaded no trajectory, or another took its place"
            )
        return self._builder
