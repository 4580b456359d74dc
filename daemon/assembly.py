"""From a checked configuration to the parts of one arm. The only place that knows them all."""

from collections.abc import Callable

import numpy as np

from daemon.config.identified import objections
from daemon.config.load import Robot
from daemon.config.motion import limits_of, row, sinusoids_of
from daemon.config.schema import Configuration
from daemon.faults.detector import DetectorSettings, FaultDetector
from daemon.faults.following import Following, FollowingSettings
from daemon.faults.plausibility import Plausibility, PlausibilitySettings
from daemon.modes.contact_reactions import Reactions
from daemon.motion.admittance import AdmittanceLaw, AllowanceSettings, Gains
from daemon.motion.motion import Motion, MotionSettings
from daemon.motion.path import Follower, Place
from daemon.tick.arming_checks import PreArm, Verdict
from daemon.tick.controller import Controller, ControllerSettings
from daemon.tick.tick import Tick
from drivers.boot.boot_up import DriveBoot
from drivers.boot.data_sheet import load_data_sheet
from drivers.boot.required_objects import DriveSetup
from drivers.can.frame_ring import FrameRing
from drivers.can.wire import OpenBus, Wire
from drivers.drives import Drives
from estimator.estimator import Estimator
from estimator.model import Model
from estimator.thresholds import Thresholds
from estimator.transmission import Transmission


def build_tick(robot: Robot, wire: Wire, clock: Callable[[], float]) -> Tick:
    """The tick of `robot` on the wire to drives that are set up. Raises ContactdError."""
    c = robot.configuration
    drives = Drives(wire, c.joint_drives, c.period_s, clock, c.bus.master_node)
    estimator, controller, observer = (
        build_estimator(c, robot.urdf),
        build_controller(robot),
        build_fault_detector(c),
    )
    prearm = PreArm(drives.names, drives.nodes, controller.motion.limits)
    return Tick(drives, estimator, controller, observer, prearm, c.period_s)


def heed_identification(tick: Tick, robot: Robot, serials: list[int | None]) -> None:
    """Let `tick` arm, and close loops over the links, only as far as `contactd identify` has shown
    that it may. serials: of the drives that answered, in the order of the joints."""
    c, found = robot.configuration, robot.identified
    against = objections(found, c, robot.urdf, dict(zip(c.joint_names, serials, strict=True)))
    text = "; ".join(against) or f"{c.identified} is of these drives"
    tick.prearm.identification = Verdict(not against, text)
    tick.controller.motion.blind = not tick.prearm.identification.passed


def build_boot(robot: Robot, bus: OpenBus, ring: FrameRing | None = None) -> DriveBoot:
    """The set-up of the drives over an open bus; `ring` keeps its frames. Raises
    ConfigurationError."""
    c = robot.configuration
    return DriveBoot(bus, build_setups(robot), c.period_ms, c.bus.master_node, ring)


def build_setups(robot: Robot) -> list[DriveSetup]:
    """What each drive shall hold before it may be operational. Raises ConfigurationError."""
    c = robot.configuration
    sheets = {
        name: load_data_sheet(robot.folder / profile.eds) for name, profile in c.drives.items()
    }
    return [
        DriveSetup(
            drive, sheets[drive.wiring.profile], joint.limits.velocity, joint.limits.quick_stop
        )
        for drive, joint in zip(c.joint_drives, c.joints, strict=True)
    ]


def build_estimator(c: Configuration, urdf: str) -> Estimator:
    """The whole chain from samples to contact."""
    return Estimator(
        Model(urdf, c.joint_names),
        build_transmission(c),
        c.estimator,
        Thresholds(
            contact=row(c, lambda j: j.thresholds.contact),
            collision=row(c, lambda j: j.thresholds.collision),
            per_speed=row(c, lambda j: j.thresholds.per_speed),
        ),
        c.period_s,
    )


def build_transmission(c: Configuration) -> Transmission:
    """Gears, gaps, rotors and friction as arrays."""
    return Transmission(
        joints=tuple(c.joint_names),
        torque_constant=row(c, lambda j: j.torque_constant),
        rotor_inertia=row(c, lambda j: j.rotor_inertia),
        half_gap=row(c, lambda j: j.half_gap),
        motor_coulomb=row(c, lambda j: j.friction.motor_coulomb),
        motor_viscous=row(c, lambda j: j.friction.motor_viscous),
        link_coulomb=row(c, lambda j: j.friction.link_coulomb),
        link_viscous=row(c, lambda j: j.friction.link_viscous),
        gap_coulomb=row(c, lambda j: j.friction.gap_coulomb),
        gap_viscous=row(c, lambda j: j.friction.gap_viscous),
        stiction=row(c, lambda j: j.friction.stiction),
        contact_stiffness=row(c, lambda j: j.gap_spring.stiffness),
        contact_damping=row(c, lambda j: j.gap_spring.damping),
        sign_width=c.estimator.sign_width,
    )


def build_fault_detector(c: Configuration) -> FaultDetector:
    """What is watched beside the contacts, and how long a nuisance may last."""
    s = c.supervisor
    patience = DetectorSettings(
        s.stale_ticks,
        s.overrun_ticks,
        min(drive.profile.master_timeout_ms for drive in c.joint_drives) / 1000.0,
    )
    bounds = PlausibilitySettings(
        lower=row(c, lambda j: j.limits.lower),
        upper=row(c, lambda j: j.limits.upper),
        speed=s.speed_margin * row(c, lambda j: j.limits.velocity),
        half_gap=row(c, lambda j: j.half_gap),
        position_margin=s.position_margin,
        current=row(c, lambda j: j.wiring.max_current_A),
        residual=s.residual_margin * row(c, lambda j: j.thresholds.collision),
        saturated_ticks=s.saturated_ticks,
        motor_drift=c.estimator.gap.velocity_bias,
        motor_scale_error=c.estimator.gap.velocity_scale_error,
    )
    following = FollowingSettings(
        deviation=s.following_margin * row(c, lambda j: j.limits.velocity),
        current=bounds.current,
        lag_s=c.control.drive_lag_ms / 1000.0,
    )
    joints = {drive.node: drive.name for drive in c.joint_drives}
    return FaultDetector(joints, patience, Plausibility(bounds), Following(following, c.period_s))


def build_controller(robot: Robot) -> Controller:
    """Modes and reactions over `build_motion`."""
    c = robot.configuration
    tuning = ControllerSettings(
        joints=tuple(c.joint_names),
        ends=tuple(joint.end for joint in c.joints),
        reactions=Reactions(c.reactions.contact, c.reactions.collision),
        quiet_s=c.admittance.quiet_s,
        after_quiet=c.admittance.after_quiet,
        bounds=AllowanceSettings(c.admittance.max_duration_s, c.admittance.max_excursion),
        enable_timeout_s=c.supervisor.enable_timeout_s,
        stop_timeout_s=c.supervisor.stop_timeout_s,
    )
    return Controller(tuning, build_motion(robot))


def build_motion(robot: Robot) -> Motion:
    """Trajectory, admittance and limits."""
    c = robot.configuration
    manner = MotionSettings(
        position_gain=c.control.position_gain,
        return_velocity=c.admittance.return_velocity,
        retract_velocity=c.reactions.retract_velocity,
        retract_distance=c.reactions.retract_distance,
    )
    usual = c.admittance.virtual_mass_s
    law = AdmittanceLaw(
        virtual_mass_s=row(c, lambda j: usual if j.virtual_mass_s is None else j.virtual_mass_s),
        velocity=np.full(len(c.joints), c.admittance.velocity),
    )
    path = robot.recorded or sinusoids_of(c)
    return Motion(
        manner=manner,
        limits=limits_of(c),
        law=law,
        gains=Gains(row(c, lambda j: j.admittance_gain)),
        follower=Follower(Place(path), c.trajectory.ramp_s),
    )
