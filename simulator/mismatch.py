"""True arm, derived from the nominal one and its mismatch: pure and seeded."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from common.arrays import Vector
from common.errors import ModelError
from common.regular_file import read_text
from simulator.description import ArmDescription, SimulationSettings
from simulator.gears import Gears
from simulator.servo import SERVO_PERIOD_S

STEADY = 1.0
"""Largest relative change of a rotor's velocity by friction in a step; the stability limit is 2, of
which the motor's own damping needs the rest."""
STEADY_LINK = 1.5
"""The same for a link: at 2 it chatters."""


@dataclass(frozen=True, slots=True)
class PlantParameters:
    """Parameters of the true arm; vectors (n,) unless stated otherwise, SI at the link side."""

    model: pin.Model
    half_gap: Vector
    rotor_inertia: Vector
    torque_constant: Vector
    coulomb: Vector
    """(2n,): link, then motor."""
    viscous: Vector
    """(2n,): link, then motor."""
    stiffness: Vector
    damping: Vector
    lower: Vector
    upper: Vector
    initial_position: Vector
    lightest_link: Vector
    """Smallest apparent inertia 1 / (M^-1)_ii found over the workspace [kg m^2]."""
    usual_link: Vector
    """Its mean over the workspace [kg m^2]."""


def load_model(description: ArmDescription) -> pin.Model:
    """Nominal pinocchio model. Raises ModelError if it does not match the described joints."""
    try:
        model = pin.buildModelFromXML(read_text(description.urdf))
    except OSError as error:
        raise ModelError(f"{description.urdf}: cannot be read: {error.strerror}") from error
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"{description.urdf}: not a readable URDF: {error}") from error
    found, expected = list(model.names)[1:], [joint.name for joint in description.joints]
    if found != expected or model.nq != model.nv:
        strangers = [name for name in expected if name not in found]
        first = f"no movable joint {strangers[0]!r}: " if strangers else ""
        raise ModelError(
            f"{description.urdf}: {first}its movable joints are {', '.join(found)}; they must be "
            f"the simulated ones in the same order: {', '.join(expected)}"
        )
    return model


def true_parameters(description: ArmDescription, settings: SimulationSettings) -> PlantParameters:
    """Nominal values times (1 +- mismatch): always the full percentage, only the sign is random.

    A sign is drawn per joint and quantity from `settings.seed`, in a fixed order; motor and link
    friction of a joint share one. Inertia tensors scale with their mass; a centre of mass moves
    along its own direction.
    """
    rng = np.random.default_rng(settings.seed)
    joints, mismatch = description.joints, settings.mismatch
    n = len(joints)

    def factor(percent: float) -> Vector:
        return 1.0 + 0.01 * percent * rng.choice((-1.0, 1.0), size=n)

    def column(field: str) -> Vector:
        return np.array([getattr(joint, field) for joint in joints], dtype=np.float64)

    model = load_model(description)
    mass, lever = factor(mismatch.mass), factor(mismatch.center_of_mass)
    for i in range(n):
        body = model.inertias[i + 1]
        model.inertias[i + 1] = pin.Inertia(
            body.mass * mass[i], body.lever * lever[i], body.inertia * mass[i]
        )
    friction = np.tile(factor(mismatch.friction), 2)
    torque_constant = column("torque_constant") * factor(mismatch.torque_constant)
    half_gap = column("half_gap") * factor(mismatch.half_gap)
    rotor_inertia = column("rotor_inertia") * factor(mismatch.rotor_inertia)
    lower, upper = column("lower"), column("upper")
    lightest, mean = _apparent_inertia(model, lower, upper)
    own = [
        settings.contact_stiffness if joint.gear_stiffness is None else joint.gear_stiffness
        for joint in joints
    ]
    stiffness, damping = contact(lightest, mean, rotor_inertia, settings, np.array(own))
    return PlantParameters(
        model=model,
        half_gap=half_gap,
        rotor_inertia=rotor_inertia,
        torque_constant=torque_constant,
        coulomb=friction * np.concatenate((column("link_coulomb"), column("motor_coulomb"))),
        viscous=friction * np.concatenate((column("link_viscous"), column("motor_viscous"))),
        stiffness=stiffness,
        damping=damping,
        lower=lower,
        upper=upper,
        initial_position=column("initial_position"),
        lightest_link=lightest,
        usual_link=mean,
    )


def true_gears(
    description: ArmDescription, settings: SimulationSettings, torque_constant: Vector
) -> Gears:
    """Gears of the true arm. torque_constant: true values (n,) [Nm/A]."""
    rated = np.array([joint.rated_current_A for joint in description.joints])
    gear = np.array([joint.gear for joint in description.joints])
    return Gears(settings.gears, gear, rated * torque_constant, settings.step_s, settings.seed)


def contact(
    lightest: Vector,
    mean: Vector,
    rotor: Vector,
    settings: SimulationSettings,
    own: Vector | None = None,
) -> tuple[Vector, Vector]:
    """Stiffness and damping (n,) of gap borders and end stops, limited for a stable integration.

    own: desired stiffness (n,), instead of that of the settings.

    With m the reduced mass of link and rotor, semi-implicit Euler needs step * sqrt(k / m) and
    step * d / m well below 2 and 1; several joints in contact share that margin.
    """
    step = settings.step_s
    light = lightest * rotor / (lightest + rotor)
    wished = settings.contact_stiffness if own is None else own
    stiffness = np.minimum(wished, light * (0.35 / step) ** 2)
    usual = mean * rotor / (mean + rotor)
    wanted = 2.0 * settings.contact_damping_ratio * np.sqrt(stiffness * usual)
    return stiffness, np.minimum(wanted, 0.3 * light / step)


def _apparent_inertia(model: pin.Model, lower: Vector, upper: Vector) -> tuple[Vector, Vector]:
    """Smallest and mean 1 / (M^-1)_ii over 200 random poses within the end stops."""
    rng, data = np.random.default_rng(0), model.createData()
    rows = np.empty((200, model.nv))
    for row in rows:
        inverse = pin.computeMinverse(model, data, rng.uniform(lower, upper))
        row[:] = 1.0 / np.diag(inverse)
    return rows.min(axis=0), rows.mean(axis=0)


def steady_steps(settings: SimulationSettings, parameters: PlantParameters) -> int:
    """Smallest number of steps per ms at which smooth friction is stable: no rotor is reversed by
    it, and no link chatters, which would reduce its mean friction."""
    if settings.friction != "smooth":
        return 1
    steep = parameters.coulomb / settings.friction_width + parameters.viscous
    of_links, of_rotors = steep.reshape(2, -1)
    fastest = np.maximum(
        of_rotors / parameters.rotor_inertia / STEADY,
        of_links / parameters.lightest_link / STEADY_LINK,
    )
    return int(np.ceil(SERVO_PERIOD_S * float(fastest.max())))
