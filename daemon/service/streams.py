"""Streams of targets: the connection that sends one, and checks of its targets."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from logging import getLogger

import numpy as np

from common.arrays import Vector
from common.errors import TrajectoryError
from daemon.motion.covered_range import CoveredRange
from daemon.motion.limits import Limits
from daemon.motion.playout import Target
from daemon.motion.target_stream import StreamSettings, TargetStream
from daemon.protocol import requests
from daemon.tick.refusals import way_to

_log = getLogger("contactd")


@dataclass(slots=True)
class Streams:
    """Stream of one arm: it belongs to the connection that began it."""

    joints: Sequence[str]
    limits: Limits
    settings: StreamSettings
    _warnings: dict[str, str] = field(default_factory=dict)  # by joint and kind
    _owner: int = 0
    _stream: TargetStream | None = None
    _fastest: Vector = field(init=False)
    _lowest: Vector = field(init=False)
    _highest: Vector = field(init=False)

    def of(self, connection: int, present: TargetStream | None) -> TargetStream | None:
        """Stream that the arm follows at `present`, if this connection sends it; else None."""
        return present if connection == self._owner and present is self._stream else None

    def refusal(self, connection: int, cause: str) -> str:
        """Reason for refusing a target from a connection that sends no stream now."""
        if connection != self._owner:
            return "this connection sends no stream: `follow` begins one"
        return f"the arm no longer follows this connection: {cause}"

    def begun(self, request: requests.Follow, q: Vector, who: str) -> TargetStream:
        """New stream from its first request, while the arm is at q (n,) [rad]. Raises
        TrajectoryError for a target of other joints, or out of reach."""
        first = self.target(request)
        self.refuse_far(first, q)
        return TargetStream(who, self.settings, self.limits, first)

    def refuse_far(self, target: Target, q: Vector, *, begun: bool = False) -> None:
        """Raise TrajectoryError, with each joint, if a target is out of reach from q (n,) [rad];
        begun: of a stream that the arm follows already."""
        apart = np.abs(target.q - q)
        beyond = ~(apart <= self.settings.reach)
        far = [
            f"{joint} stands at {q[i]:.3f} rad, {apart[i]:.3f} rad from the target "
            f"({target.q[i]:.3f}; `stream.reach` allows {self.settings.reach:g})"
            for i, joint in enumerate(self.joints)
            if beyond[i]
        ]
        if far:
            advice = way_to(self.joints, np.where(beyond, target.q, np.nan))
            if begun:
                advice = "lead the arm or the stream nearer, or end the stream first: " + advice
            raise TrajectoryError("; ".join([*far, advice]))

    def own(self, stream: TargetStream, connection: int) -> None:
        """Record the connection that sends a stream, once the arm follows it."""
        self._stream, self._owner, self._warnings = stream, connection, {}
        self._lowest = self._highest = stream.moves.q
        self._fastest = np.zeros_like(self._lowest)

    @property
    def warnings(self) -> list[str]:
        """Warnings that the stream moved faster or further than its thresholds cover, in order of
        occurrence."""
        return list(self._warnings.values())

    def compare(self, seen: CoveredRange) -> None:
        """Warn if the stream has moved faster or further than the thresholds cover. Unlike a path,
        it can be compared only while it runs."""
        assert self._stream is not None
        moves = self._stream.moves
        self._fastest = np.maximum(self._fastest, np.abs(moves.velocity))
        self._lowest = np.minimum(self._lowest, moves.q)
        self._highest = np.maximum(self._highest, moves.q)
        found = seen.warnings(self.joints, self._fastest, self._lowest, self._highest)
        for text in found:
            kind = " ".join(text.split()[:3])
            if kind not in self._warnings:
                _log.warning("the stream of %s: %s", self._stream.sender, text)
            self._warnings[kind] = text

    def target(self, request: requests.Follow | requests.Target) -> Target:
        """Target of a request. Raises TrajectoryError for one of other joints."""
        velocity = request.velocity if isinstance(request, requests.Target) else None
        for name, values in (("q", request.q), ("velocity", velocity)):
            if values is not None and len(values) != len(self.joints):
                raise TrajectoryError(
                    f"`{name}` has {len(values)} numbers; this arm has {len(self.joints)} joints: "
                    f"{', '.join(self.joints)}"
                )
        speed = None if velocity is None else np.array(velocity, dtype=float)
        return Target(request.number, request.sent_s, np.array(request.q, dtype=float), speed)
