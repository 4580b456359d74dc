"""Steps of the identification, in the order in which a person needs them."""

from typing import Final

from programs.identify.step import Step
from programs.identify.steps import (
    encoders,
    friction,
    gap,
    masses,
    payload,
    thresholds,
    wiring,
    zero,
)

STEPS: Final[dict[str, Step]] = {
    step.name: step
    for step in (
        *(zero.zero, wiring.wiring, gap.gap, masses.masses),
        *(payload.payload, friction.friction, encoders.encoders, thresholds.thresholds),
    )
}
