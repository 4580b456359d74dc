"""URDF reading by pinocchio: order of the joints, bodies, hand, tool, reach."""

import math
from pathlib import Path

import numpy as np
import pinocchio as pin

from common.errors import ModelError
from common.regular_file import read_text
from estimator.dynamics import Body
from estimator.urdf import MovedLink, moved_links

_NO_INERTIA = 1e-12  # [kg m2], of a milligram at a millimetre: less is rounding
_OFF_AXIS = 0.01  # [m]; nearer to the joint a force has no lever arm


def read_urdf(urdf: Path | str) -> tuple[pin.Model, tuple[MovedLink, ...]]:
    """pinocchio's model of a URDF (a file, or the text of one), and its moving links."""
    where = "the URDF" if isinstance(urdf, str) else str(urdf)
    try:
        text = urdf if isinstance(urdf, str) else read_text(urdf)
        links = tuple(moved_links(text))
        mass = sum(link.mass for link in links)
        model = pin.buildModelFromXML(text)
    except ModelError as error:
        raise ModelError(f"{where}: {error}") from error
    except (OSError, ValueError, RuntimeError) as error:
        raise ModelError(f"{where}: not a URDF that can be read: {error}") from error
    # XML turns tabs within a value into spaces; pinocchio's parser does not, and drops the link.
    read = sum(body.mass for body in list(model.inertias)[1:])
    if not math.isclose(read, mass, rel_tol=1e-6):
        raise ModelError(
            f"{where}: pinocchio reads only {read:g} of the {mass:g} kg that move: no tab and no "
            "line break is allowed within a value of an <inertial>"
        )
    return model, links


def order_of(model: pin.Model, joints: tuple[str, ...], urdf: str) -> np.ndarray:
    """Index of each of the caller's joints in pinocchio's vectors."""
    movable = list(model.names)[1:]
    for name in joints:
        if name not in movable:
            raise ModelError(f"{urdf}: no movable joint {name!r}; it has {', '.join(movable)}")
        if joints.count(name) > 1:
            raise ModelError(f"joint {name!r} is named twice")
    for name in movable:
        if name not in joints:
            raise ModelError(f"{urdf}: joint {name!r} moves but is not measured; make it fixed")
        joint = model.joints[model.getJointId(name)]
        # A prismatic joint has one coordinate, too, but in m: its weight in N would count as Nm.
        if joint.nq != 1 or joint.nv != 1 or not joint.shortname().startswith("JointModelR"):
            raise ModelError(f"{urdf}: joint {name!r} must be revolute, with limits")
    return np.array([model.joints[model.getJointId(name)].idx_v for name in joints])


def body_of(model: pin.Model, coordinate: int, row: int) -> Body:
    """Body of joint `coordinate` + 1; coordinates are in the order of the joints."""
    index = coordinate + 1
    joint, inertia = model.joints[index], model.inertias[index]
    placement = model.jointPlacements[index]
    data = joint.createData()
    joint.calc(data, np.zeros(model.nq), np.zeros(model.nv))
    axis = np.asarray(data.S).ravel()
    return Body(
        parent=model.parents[index] - 1,
        row=row,
        rotation=placement.rotation.copy(),
        translation=placement.translation.copy(),
        turning=axis[3:],
        sliding=axis[:3],
        mass=inertia.mass,
        moment=inertia.mass * inertia.lever,
        inertia=inertia.matrix()[3:, 3:].copy(),
    )


def hand_of(model: pin.Model) -> tuple[str, pin.SE3]:
    """Name of the URDF's last link, and the pose of its frame in that of the last joint."""
    joint = model.njoints - 1
    links = [
        frame
        for frame in model.frames
        if frame.parentJoint == joint and frame.type == pin.FrameType.BODY
    ]
    return links[-1].name, links[-1].placement.copy()


def add_tool(model: pin.Model) -> tuple[str, int]:
    """Description of the tool point, and index of its frame: the origin of the URDF's last link if
    that is off the axis of the last joint, as a fixed `tool0` is; else the centre of mass of that
    joint's body, because the origin of a link on its own axis has no lever arm."""
    joint = model.njoints - 1
    links = [
        (i, frame)
        for i, frame in enumerate(model.frames)
        if frame.parentJoint == joint and frame.type == pin.FrameType.BODY
    ]
    index, link = links[-1]
    if np.linalg.norm(link.placement.translation) > _OFF_AXIS:
        return f"the origin of {link.name}", index
    center = pin.SE3(np.eye(3), model.inertias[joint].lever)
    frame = pin.Frame("centre of mass of the tool", joint, center, pin.FrameType.OP_FRAME)
    # Appending the frame's inertia, of zero, would round that of the joint.
    return f"the centre of mass of {link.name}", model.addFrame(frame, append_inertia=False)


def reach_of(model: pin.Model) -> float:
    """Longest distance [m] from the first joint along the chain to the far end of a body."""
    way = np.zeros(model.njoints)
    ends = np.zeros(model.njoints)
    for i in range(1, model.njoints):
        parent = model.parents[i]
        if parent:
            way[i] = way[parent] + np.linalg.norm(model.jointPlacements[i].translation)
        ends[i] = way[i] + 2.0 * np.linalg.norm(model.inertias[i].lever)
    return float(ends.max())


def refuse_weightless(model: pin.Model, urdf: str) -> None:
    """Raise ModelError for a joint that moves no mass, or whose M_ii vanishes: M would be
    singular."""
    data = model.createData()
    pin.computeSubtreeMasses(model, data)
    lower, upper = model.lowerPositionLimit, model.upperPositionLimit
    poses = (np.clip(0.0, lower, upper), lower, 0.5 * (lower + upper), upper)
    least = np.min([np.diag(pin.crba(model, data, q)) for q in poses], axis=0)
    for name in list(model.names)[1:]:
        joint = model.getJointId(name)
        if not data.mass[joint] > 0:
            raise ModelError(
                f"{urdf}: nothing that joint {name!r} moves has a mass; its link needs an "
                "<inertial> with mass, in kg, and inertia"
            )
        if not (inertia := least[model.joints[joint].idx_v]) > _NO_INERTIA:
            raise ModelError(
                f"{urdf}: joint {name!r} moves an inertia of {inertia:.3g} kg m2 about its axis "
                f"in some pose; it must be above {_NO_INERTIA:g}: the links need their <inertia>"
            )
