"""True arm, made of the nominal one and its mismatch: pure and seeded."""

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
"""Most by which friction may change a rotor's velocity in a step, as a share of it; its motor's own
damping needs the rest of 2."""
STEADY_LINK = 1.5
"""The same of a link: at 2 it chatters."""


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
    """The nominal pinocchio model. Raises ModelError when it is not the described chain."""
    try:
        model = pin.buildModelFromXML(read_text(description.urdf))
    except OSError as error:
        raise ModelError(f"{description.urdf}: cannot be read: {error.strerror}") from error
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"{description.urdf}: not a readable URDF: {error}") from error
    found, expected = list(model.names)[1:], [joint.name for joint in description.joints]
    if found != expected or model.nq != model.nv:
        strangers = [name for name in expected if name not in found]
        first = f"no joint {strangers[0]!r} moves: " if strangers else ""
        raise ModelError(
            f"{description.urdf}: {first}it moves {', '.join(found)}; to be simulated are "
            f"{', '.join(expected)}, which have to be the same in the same order"
        )
    return model


def true_parameters(description: ArmDescription, settings: SimulationSettings) -> PlantParameters:
    """Nominal values times (1 +- mismatch): always the whole percentage, only the sign is drawn.

    A sign is drawn per joint and quantity from `settings.seed`, in a fixed order; motor and link
    friction of a joint share theirs. Masses take their inertia tensor along; a centre of mass
    moves along its own direction.
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
    """Gears of the true arm, whose torque constant is (n,) [Nm/A]."""
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
    """Stiffness and damping (n,) of gap borders and end stops that an explicit step can carry.

    own: stiffness (n,) that the joints would have, instead of the settings'.

    With m the reduced mass of link and rotor, semi-implicit Euler needs step * sqrt(k / m) and
    step * d / m well below 2 and 1; several joints in contact at once take a share each.
    """
    step = settings.step_s
    light = lightest * rotor / (lightest + rotor)
    wished = settings.contact_stiffness if own is None else own
    stiffness = np.minimum(wished, light * (0.35 / step) ** 2)
    usual = mean * rotor / (mean + rotor)
    wanted = 2.0 * settings.contact_damping_ratio * np.sqrt(stiffness * usual)
    return stiffness, np.minimum(wanted, 0.3 * light / step)


def _apparent_inertia(model: pin.Model, lower: Vector, upper: Vector) -> tuple[Vector, Vector]:
    """Smallest and mean 1 / (M^-1)_ii over 200 poses inside the end stops."""
    rng, data = np.random.default_rng(0), model.createData()
    rows = np.empty((200, model.nv))
    for row in rows:
        inverse = pin.computeMinverse(model, data, rng.uniform(lower, upper))
        row[:] = 1.0 / np.diag(inverse)
    return rows.min(axis=0), rows.mean(axis=0)


def steady_steps(settings: SimulationSettings, parameters: PlantParameters) -> int:
    """Least number of steps per ms in which smooth friction turns no rotor round by itself, and
    lets no link chatter, whose mean friction would be less than Coulomb's."""
    if settings.friction != "smooth":
        return 1
    steep = parameters.coulomb / settings.friction_width + parameters.viscous
    of_links, of_rotors = steep.reshape(2, -1)
    fastest = np.maximum(
        of_rotors / parameters.rotor_inertia / STEADY,
        of_links / parameters.lightest_link / STEADY_LINK,
    )
    return int(np.ceil(SERVO_PERIOD_S * float(fastest.max())))
