"""Logs of several sittings, between which a link moved unseen."""

import numpy as np
import pytest

from errors import LogError
from estimator.identification.log_checks import refuse_implausible
from estimator.identification.motion_log import MotionLog

T = 0.01 * np.arange(1000)
Q = 0.2 * np.sin(0.5 * np.pi * T)


def sittings(*offsets: float, sign: float = 1.0) -> MotionLog:
    """The same motion, from another place each time [rad]; the motor's velocity has a bias."""
    time_s = np.concatenate([T + 20.0 * k for k in range(len(offsets))])
    q = np.concatenate([Q + offset for offset in offsets])
    velocity = np.tile(sign * np.gradient(Q, T) + 0.002, len(offsets))
    columns = (np.zeros_like(q), q, velocity)
    return MotionLog(("j",), time_s, *(one[:, None] for one in columns))


@pytest.mark.parametrize("offsets", [(0.0,), (0.0, 1.4), (0.7, -0.7, 0.7)])
def test_a_link_that_moved_between_sittings_is_no_wrong_sign(offsets: tuple[float, ...]) -> None:
    refuse_implausible(sittings(*offsets), np.array([1.0]))
    with pytest.raises(LogError, match="link and motor of j do not move together"):
        refuse_implausible(sittings(*offsets, sign=-1.0), np.array([1.0]))
