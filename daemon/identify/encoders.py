"""Step of the identification that finds what link encoders err with each turn."""

import numpy as np

from daemon.config import identified as file
from daemon.config.load import Robot
from daemon.identify.measured import Measured
from daemon.identify.steps import Line, Outcome
from drivers.settings import Harmonic
from estimator.identification.link_encoder import link_encoder


def encoders_step(robot: Robot, measured: Measured, joints: list[str], date: str) -> Outcome:
    """Find what the link encoders of the named joints err with each turn.

    It is added to what is taken off the samples already. A joint where nothing is found keeps that.
    """
    lines, entries = [], dict[str, file.Entry]()
    for name in joints:
        joint = robot.configuration.joints[robot.configuration.joint_names.index(name)]
        wiring = joint.wiring
        found = link_encoder(measured.log, measured.log.joints.index(name), wiring.link_offset,
                             wiring.gear, joint.torque_constant)  # fmt: skip
        good, figures = bool(found.harmonics), ""
        if good:
            figures = ", ".join(
                f"{1e3 * np.hypot(cosine, sine):.2f} mrad {order} x per turn"
                for order, cosine, sine in found.harmonics
            )
            figures += f"; leaves {found.left:.0%} of the scatter"
            entries[name] = file.EncodersEntry(
                date=date,
                log=measured.sha256,
                link_correction=_together(wiring.link_correction, found.harmonics),
                left=round(found.left, 3),
            )
        lines.append(Line(name, "found" if good else "nothing found", good, figures, found.reason))
    return Outcome(lines, entries, measured.notes)


def _together(old: list[Harmonic], found: tuple[tuple[int, float, float], ...]) -> list[Harmonic]:
    """Harmonics that take off what the old ones do and what is left beside them."""
    table = {h.order: (h.cosine, h.sine) for h in old}
    for order, cosine, sine in found:
        before = table.get(order, (0.0, 0.0))
        table[order] = (before[0] + cosine, before[1] + sine)
    return [
        Harmonic(order=order, cosine=round(float(c), 7), sine=round(float(s), 7))
        for order, (c, s) in sorted(table.items())
    ]
