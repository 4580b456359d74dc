"""Detected, missed and false contacts, by tables."""

import numpy as np
import pytest

from bench.study.contacts import Count, Stretch, count_contacts, count_joint, stretches

PERIOD = 0.1
FADE = 0.2  # two ticks
LEVEL = 1.0


@pytest.mark.parametrize(
    ("what", "torque", "detected", "expected"),
    [
        ("nothing", [0, 0, 0, 0], [0, 0, 0, 0], Count()),
        ("at once", [0, 2, 2, 0], [0, 1, 1, 0], Count(1, 0, 0, [0.0])),
        ("late", [0, 2, 2, 2], [0, 0, 0, 1], Count(1, 0, 0, [0.2])),
        ("rising: from the level on", [0, 0.5, 1, 2], [0, 0, 0, 1], Count(1, 0, 0, [0.1])),
        ("detected below the level", [0, 0.5, 0.5, 1], [0, 1, 1, 1], Count(1, 0, 0, [-0.2])),
        ("missed", [0, 2, 2, 0], [0, 0, 0, 0], Count(0, 1, 0)),
        ("too small to be missed", [0, 0.9, 0.9, 0], [0, 0, 0, 0], Count()),
        ("small, detected all the same", [0, 0.9, 0.9, 0], [0, 0, 1, 0], Count(1, 0, 0)),
        ("false", [0, 0, 0, 0], [0, 1, 1, 0], Count(0, 0, 1)),
        ("before it", [0, 0, 2, 2], [0, 1, 1, 1], Count(1, 0, 1, [0.0])),
        ("the wrong way", [0, 2, 2, 0], [0, -1, -1, 0], Count(0, 1, 1)),
        ("pushed down", [0, -2, -2, 0], [0, 0, -1, 0], Count(1, 0, 0, [0.1])),
        ("still fading", [2, 2, 0, 0, 0], [1, 1, 1, 0, 0], Count(1, 0, 0, [0.0])),
        ("again while it fades", [2, 2, 0, 0, 0], [1, 0, 0, 1, 0], Count(1, 0, 0, [0.0])),
        ("again when it has faded", [2, 2, 0, 0, 0], [1, 0, 0, 0, 1], Count(1, 0, 1, [0.0])),
        ("only when it was over", [2, 2, 0, 0, 0], [0, 0, 1, 0, 0], Count(0, 1, 0)),
        ("chattering", [2, 2, 2, 2], [1, 0, 1, 0], Count(1, 0, 0, [0.0])),
        ("to and fro", [2, 2, -2, -2], [0, 1, -1, -1], Count(2, 0, 0, [0.1, 0.0])),
        ("one of two", [2, 0, 0, 0, 2], [1, 0, 0, 0, 0], Count(1, 1, 0, [0.0])),
    ],
)
def test_one_joint(what, torque, detected, expected):
    count = count_joint(np.array(torque, float), np.array(detected, float), LEVEL, PERIOD, FADE)
    assert count == expected, what


def test_a_contact_on_another_joint_is_missed_here_and_false_there():
    torque = np.array([[0, 0], [2, 0], [2, 0]], float)
    detected = np.array([[0, 0], [0, 1], [0, 1]], float)
    assert count_contacts(torque, detected, [LEVEL, LEVEL], PERIOD) == [
        Count(0, 1, 0),
        Count(0, 0, 1),
    ]


def test_stretches_are_cut_where_the_sign_changes():
    signal = np.array([1.0, 3.0, -2.0, 0.0, -1.0])
    assert stretches(signal) == [
        Stretch(0, 2, 1, 3.0),
        Stretch(2, 3, -1, 2.0),
        Stretch(4, 5, -1, 1.0),
    ]
