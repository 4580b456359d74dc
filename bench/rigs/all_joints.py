"""Motion of all joints of Romeo's arm, in which each moves at its own frequency."""

from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from daemon.config.schema import Configuration, Sinusoid, Trajectory

# Amplitude [rad] and frequency [Hz] per joint: incommensurable, so that all poses are met.
MOTION: Final = {
    "LShoulderPitch": (0.35, 0.15),
    "LShoulderYaw": (0.15, 0.23),
    "LElbowRoll": (0.5, 0.19),
    "LElbowYaw": (0.3, 0.29),
    "LWristRoll": (0.6, 0.13),
    "LWristYaw": (0.2, 0.31),
    "LWristPitch": (0.4, 0.37),
}


def moving(motion: Mapping[str, tuple[float, float]]) -> Callable[[Configuration], Configuration]:
    """Change of the configuration: this trajectory, motor positions measured, one residual."""
    waves = {n: Sinusoid(amplitude=a, frequency_Hz=f) for n, (a, f) in motion.items()}

    def change(c: Configuration) -> Configuration:
        trajectory = Trajectory(sinusoids=waves, ramp_s=2.0)
        estimator = msgspec.structs.replace(c.estimator, beside=(), motor_position="measured")
        return msgspec.structs.replace(c, trajectory=trajectory, estimator=estimator)

    return change
