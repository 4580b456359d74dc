"""Shape of a payload with a stated bounding box: capsules and corners, added to the links'."""

import math
from typing import Final

import numpy as np
from msgspec import structs

from common.arrays import Vector
from daemon.config.shapes import CapsuleEntry, CornersEntry, LeftOut, Walls
from estimator.model import Model
from estimator.payload import Payload

PAYLOAD: Final = "payload"
"""Name of that shape."""


def with_payload(walls: Walls, payload: Payload, model: Model) -> Walls:
    """Walls with the shape of a payload's box added to the hand joint. A shape that may touch every
    capsule of that joint, and is unguarded for that, is not guarded against the payload either."""
    shapes, joint, box = walls.shapes, model.names[model.hand_joint], np.array(payload.box)
    capsules = [
        CapsuleEntry(
            name=PAYLOAD,
            joint=joint,
            start=tuple(model.in_joint(payload.com + start).tolist()),
            end=tuple(model.in_joint(payload.com + end).tolist()),
            radius=radius,
            edged=True,
        )
        for start, end, radius in capsules_of_box(box)
    ]
    hand = {one.name for one in shapes.capsules if one.joint == joint}
    beside = [
        {*left.pair} - hand
        for left in shapes.left_out
        if left.why != "never" and hand & {*left.pair}
    ]
    left_out = [
        LeftOut(pair=(PAYLOAD, one.name), why="as the hand")
        for one in {one.name: one for one in shapes.capsules}.values()
        if hand and beside.count({one.name}) == len(hand)
    ]
    signs = np.array(np.meshgrid(*([-0.5, 0.5],) * 3)).reshape(3, 8).T
    points = [tuple(model.in_joint(payload.com + sign * box).tolist()) for sign in signs]
    more = structs.replace(
        shapes,
        capsules=[*shapes.capsules, *capsules],
        corners=[*shapes.corners, CornersEntry(name=PAYLOAD, joint=joint, points=points)],
        left_out=[*shapes.left_out, *left_out],
    )
    return structs.replace(walls, shapes=more)


def capsules_of_box(edges: Vector) -> list[tuple[Vector, Vector, float]]:
    """Capsules that enclose a box with these edge lengths (3,) [m], centred at the origin: start
    and end points (3,) [m], radii [m]. Up to three lie side by side along its longest edge.

    For a bar with distance r from axis to edge, the radius R = 2 r / sqrt(3) minimises the mean
    width; the segment is then R shorter than the bar.
    """
    short, middle, along = np.argsort(edges).tolist()
    bars = min(3, max(1, round(edges[middle] / edges[short])))
    radius = math.hypot(edges[short], edges[middle] / bars) / math.sqrt(3.0)
    half = 0.5 * max(edges[along] - radius, 0.0) * np.eye(3)[along]
    across = edges[middle] / bars * np.eye(3)[middle]
    places = [(k - 0.5 * (bars - 1)) * across for k in range(bars)]
    return [(place - half, place + half, radius) for place in places]
