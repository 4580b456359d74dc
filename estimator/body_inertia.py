"""Body inertia: mass, centre of mass and inertia tensor of everything that one joint moves, and the
ten parameters in which torques are linear."""

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from common.arrays import Matrix, Vector
from common.errors import ModelError

PARAMETERS = 10
"""m, m c (3), and I about the joint's origin as xx, xy, yy, xz, yz, zz: the order of pinocchio"""
_LOWER = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # of I in the parameters
_URDF = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))  # of an <inertia>

BodyMass = Annotated[float, Meta(gt=0, le=1000)]
Center = Annotated[float, Meta(ge=-5, le=5)]
Moment = Annotated[float, Meta(ge=-1000, le=1000)]


class BodyInertia(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that a joint moves up to the next joints, as one body, in the frame of the joint's
    child link; it replaces the <inertial> of that link and of the links fixed to it."""

    mass: BodyMass  # [kg]
    com: tuple[Center, Center, Center]  # centre of mass [m]
    # about the centre of mass: ixx, ixy, ixz, iyy, iyz, izz [kg m2]
    inertia: tuple[Moment, Moment, Moment, Moment, Moment, Moment]

    def tensor(self) -> Matrix:
        """Inertia tensor (3, 3) about the centre of mass [kg m2]."""
        return _symmetric(_URDF, self.inertia)

    @classmethod
    def of(cls, parameters: Vector) -> "BodyInertia":
        """Body with these ten parameters, rounded to six digits."""
        m, h = float(parameters[0]), parameters[1:4]
        com = h / m
        about_origin = _symmetric(_LOWER, parameters[4:])
        tensor = about_origin - m * (com @ com * np.eye(3) - np.outer(com, com))

        def rounded(values: Vector) -> tuple[float, ...]:
            return tuple(float(f"{x:.6g}") for x in values)

        (mass,) = rounded(np.array([m]))
        moments = np.array([tensor[at] for at in _URDF])
        return msgspec.convert(
            {"mass": mass, "com": rounded(com), "inertia": rounded(moments)}, cls
        )


def refuse_impossible(name: str, body: BodyInertia) -> None:
    """Raise ModelError for a tensor that no mass distribution has: a principal moment that is not
    positive, or exceeds the sum of the two others."""
    principal = np.linalg.eigvalsh(body.tensor())
    if principal[0] <= 0.0 or principal[2] > principal[0] + principal[1]:
        figures = ", ".join(f"{x:.3g}" for x in principal)
        raise ModelError(
            f"body of {name}: principal moments of {figures} kg m2 are impossible: each must be "
            "above 0, and at most the sum of the two others"
        )


def pseudo_inertia(parameters: Vector) -> Matrix:
    """Pseudo-inertia (4, 4) [[sum of m x x^T, m c], [m c^T, m]] of ten parameters: positive
    definite exactly for physically possible bodies (Wensing, Kim, Slotine 2018)."""
    about_origin = _symmetric(_LOWER, parameters[4:])
    P = np.empty((4, 4))
    P[:3, :3] = 0.5 * np.trace(about_origin) * np.eye(3) - about_origin
    P[:3, 3] = P[3, :3] = parameters[1:4]
    P[3, 3] = parameters[0]
    return P


def parameters_of(pseudo: Matrix) -> Vector:
    """Ten parameters of a pseudo-inertia (4, 4)."""
    square = pseudo[:3, :3]
    about_origin = np.trace(square) * np.eye(3) - square
    return np.array([pseudo[3, 3], *pseudo[:3, 3], *(about_origin[at] for at in _LOWER)])


def point_mass(mass: float, place: Vector) -> Vector:
    """Ten parameters of a point mass [kg] at a place (3,) [m]."""
    r = np.append(place, 1.0)
    return parameters_of(mass * np.outer(r, r))


def _symmetric(places: tuple[tuple[int, int], ...], values: Vector | tuple[float, ...]) -> Matrix:
    full = np.empty((3, 3))
    for (a, b), value in zip(places, values, strict=True):
        full[a, b] = full[b, a] = value
    return full
