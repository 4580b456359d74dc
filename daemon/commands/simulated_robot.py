"""Simulated counterpart of a robot: the nominal arm from its configuration, and the deviations of
the true one (`simulation.yaml` beside `config.yaml`; defaults where there is none)."""

import msgspec

from daemon.config.load import Robot, convert
from daemon.config.schema import Joint
from daemon.config.yaml_source import read_yaml
from drivers.settings import Settings
from errors import ConfigurationError
from estimator.model import Model
from simulator.description import ArmDescription, JointDescription, SimulationSettings


class SimulationFile(Settings, frozen=True):
    """Schema of `simulation.yaml`."""

    initial_position: dict[str, float] = msgspec.field(default_factory=dict)  # [rad], others 0
    settings: SimulationSettings = SimulationSettings()


def read_simulation(robot: Robot) -> SimulationFile:
    """Settings of the robot's simulation. Raises ConfigurationError."""
    path = robot.folder / "simulation.yaml"
    if not path.exists():
        return SimulationFile()
    source = read_yaml(path)
    simulation = convert(source, SimulationFile)
    for name in simulation.initial_position:
        if name not in robot.configuration.joint_names:
            known = ", ".join(robot.configuration.joint_names)
            line = source.line(["initial_position", name])
            raise ConfigurationError(
                f"{path}:{line}: initial_position.{name}: no such joint; there are: {known}"
            )
    return simulation


def describe(robot: Robot, simulation: SimulationFile) -> ArmDescription:
    """Nominal arm, as its maker would describe it. Identified values are left out, or the arm would
    change with every identification. Raises ConfigurationError."""
    configuration = robot.by_hand or robot.configuration
    model = Model(robot.urdf, configuration.joint_names)
    profiles = {joint.wiring.profile for joint in configuration.joints}
    if len(profiles) > 1:
        raise ConfigurationError(
            f"{robot.path}: drives: the joints use {', '.join(sorted(profiles))}; only one profile "
            "can be simulated"
        )
    return ArmDescription(
        urdf=robot.folder / configuration.urdf,
        eds=robot.folder / configuration.drives[profiles.pop()].eds,
        joints=tuple(
            _joint(
                joint,
                float(model.lower[i]),
                float(model.upper[i]),
                simulation.initial_position.get(joint.name, 0.0),
            )
            for i, joint in enumerate(configuration.joints)
        ),
        period_s=configuration.period_s,
    )


def _joint(joint: Joint, lower: float, upper: float, start: float) -> JointDescription:
    """Nominal joint, whose end stops are the URDF's limits; the daemon's own lie inside."""
    return JointDescription(
        name=joint.name,
        node=joint.wiring.node,
        gear=joint.wiring.gear,
        rated_current_A=joint.wiring.rated_current_A,
        max_current_A=joint.wiring.max_current_A,
        torque_constant=joint.torque_constant,
        rotor_inertia=joint.rotor_inertia,
        half_gap=joint.half_gap,
        motor_coulomb=joint.friction.motor_coulomb,
        motor_viscous=joint.friction.motor_viscous,
        link_coulomb=joint.friction.link_coulomb,
        link_viscous=joint.friction.link_viscous,
        lower=lower,
        upper=upper,
        initial_position=start,
        brake=joint.end == "brake",
    )
