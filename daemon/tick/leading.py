"""Requests that change how a hand leads the arm, in any mode: gains and guide."""

from dataclasses import dataclass

from common.errors import ModelError
from daemon.modes.machine import Change, ModeMachine
from daemon.motion.motion import Motion
from daemon.protocol.bounds import LEAST_GAIN, MAX_GAIN
from daemon.protocol.guide import GuideAxes
from daemon.protocol.requests import SetGain, SetGuide


@dataclass(frozen=True, slots=True)
class Leading:
    """Handler of these requests for one arm; each method returns the reasons for a refusal."""

    machine: ModeMachine
    motion: Motion
    joints: tuple[str, ...]

    def change(self, request: SetGain | SetGuide, who: str) -> tuple[list[str], str]:
        """Carry out a request; returns the reasons for a refusal, and the subject as text."""
        if isinstance(request, SetGuide):
            return self.set_guide(request.axes, who), str(request.axes)
        joint, gain = request.joint, request.gain
        return self.set_gain(joint, gain, who), f"{joint} {gain:g} rad/s per Nm"

    def set_gain(self, joint: str, gain: float, who: str) -> list[str]:
        """Ramp K_a [rad/s per Nm] of a joint to `gain`."""
        if joint not in self.joints:
            return [f"no joint {joint!r}; there are: {', '.join(self.joints)}"]
        if gain != 0.0 and not LEAST_GAIN <= gain <= MAX_GAIN:  # nor NaN
            return [f"{gain:.15g} is not a gain: 0, or {LEAST_GAIN:g} to {MAX_GAIN:g} rad/s per Nm"]
        i = self.joints.index(joint)
        text = f"gain of {joint} {self.motion.gains.goal[i]:g} -> {gain:g} rad/s per Nm"
        self.motion.gains.change(i, gain)
        self.machine.changes.append(Change(text, f"by {who}"))
        return []

    def set_guide(self, axes: GuideAxes, who: str) -> list[str]:
        """Replace the guide."""
        if reasons := axes.objections(len(self.joints)):
            return reasons
        text = f"guide {self.motion.guidance.axes} -> {axes}"
        try:
            self.motion.guidance.change(axes)
        except ModelError as error:
            return [str(error)]
        self.machine.changes.append(Change(text, f"by {who}"))
        return []
