"""Figures of `bench.hand` against what the hand did."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.study.leading import Meter
from simulator.hand import Guide, Hand, Push, Release

NAMES = ("a", "b")


def meter(*script: object) -> tuple[Meter, SimpleNamespace]:
    arm = SimpleNamespace(plant=SimpleNamespace(q_dot=np.zeros(2)), now=0.0)
    return Meter(Hand(script, NAMES, np.full(2, 100.0)), arm), arm


def test_work_is_torque_times_way() -> None:
    hand, arm = meter(Push(at_s=0.1, joint="b", torque=-3.0, duration_s=1.0))
    arm.plant.q_dot[:] = 0.2, -0.5
    for ms in range(1500):
        hand.update(ms / 1000, np.zeros(2))
    led = hand.led(NAMES, 1, 1.0)
    assert led.peak_nm == led.usual_nm == 3.0
    assert led.work_j == pytest.approx(3.0 * 0.5, rel=2e-3)
    assert led.moved_rad == pytest.approx(-0.5, rel=2e-3)
    assert led.tremble == 0.0
    assert hand.led(NAMES, 0, 1.0).work_j == 0.0
    assert hand.done


def test_a_joint_that_shakes_trembles() -> None:
    script = (Guide(at_s=0.0, to={"a": 0.5}, speed=0.25), Release(at_s=2.0))
    hand, arm = meter(*script)
    q = np.zeros(2)
    for ms in range(2100):
        arm.plant.q_dot[0] = 0.25 * (1.0 + 0.5 * np.sin(2 * np.pi * ms / 100))
        q = q + 0.001 * arm.plant.q_dot
        hand.update(ms / 1000, q)
    assert hand.led(NAMES, 0, 2.0).tremble == pytest.approx(0.5 / np.sqrt(2), rel=1e-2)
