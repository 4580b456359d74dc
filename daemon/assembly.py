"""Assembly of one arm from a checked configuration: the only module that knows all its parts.

Its drives come ready made, from `daemon.drives`.
"""

from collections.abc import Sequence

import numpy as np

from common.arrays import Vector
from daemon.arming.checks import ArmingChecks
from daemon.config.evidence import objections, parameters_known, parameters_missing
from daemon.config.identified import ThresholdsEntry, used_entries
from daemon.config.load import Robot
from daemon.config.schema import Configuration
from daemon.config.shapes import clearance_of
from daemon.config.trajectories import path_of
from daemon.config.vectors import guide_of, limits_of, row, virtual_mass_of
from daemon.faults.detector import DetectorSettings, FaultDetector, tolerated_ticks
from daemon.faults.following import Following, FollowingSettings
from daemon.faults.ignored_setpoints import IgnoredSetpoints
from daemon.faults.plausibility import Plausibility, PlausibilitySettings
from daemon.modes.contact_reactions import Reactions
from daemon.motion.admittance import AdmittanceLaw, AllowanceSettings, Gains
from daemon.motion.covered_range import CoveredRange
from daemon.motion.hand_witness import HandWitness
from daemon.motion.motion import Motion, MotionSettings
from daemon.motion.path import Follower, PathPoint
from daemon.motion.release import ReleaseSettings
from daemon.protocol.replies import Check
from daemon.tick.controller import Controller
from daemon.tick.decision import ControllerSettings
from daemon.tick.tick import Tick
from drivers.api import Drives
from estimator.estimator import Estimator
from estimator.model import Model
from estimator.thresholds import Thresholds
from estimator.transmission import Transmission, load_range, stiction_range
from estimator.walls import Walls

# Share of the permitted deviation of drives from their setpoints that a release uses.
AHEAD_SHARE = 0.75


def build_tick(robot: Robot, drives: Drives, identification: Check) -> Tick:
    """Tick of `robot` with drives that are set up. Unless the `identification` check passes, it
    does not arm and closes no loop over the links. Raises ContactdError."""
    c = robot.configuration
    return Tick(
        drives,
        build_estimator(c, robot.model),
        build_controller(robot, links_trusted=identification.passed),
        build_fault_detector(c),
        c.period_s,
    )


def build_arming_checks(robot: Robot, tick: Tick, identification: Check) -> ArmingChecks:
    """Arming checks of `robot` on its tick; identification: `check_identification`."""
    c = robot.configuration
    return ArmingChecks(
        tick,
        limits_of(c),
        c.period_s,
        (identification, check_parameters(robot)),
        row(c, lambda j: j.thresholds.contact),
    )


def covered_range(robot: Robot) -> CoveredRange:
    """Motion covered by the identified thresholds; unbounded where they do not record it."""
    c = robot.configuration
    speed, lower, upper = (np.full(len(c.joints), end) for end in (np.inf, -np.inf, np.inf))
    for i, joint in enumerate(c.joints):
        entry = used_entries(joint, robot.identified).get("thresholds")
        if isinstance(entry, ThresholdsEntry) and (seen := entry.seen) is not None:
            speed[i], lower[i], upper[i] = seen.speed, seen.lower, seen.upper
    return CoveredRange(speed, lower, upper)


def check_identification(robot: Robot, serials: Sequence[int | None]) -> Check:
    """Arming check of identified.yaml: it must belong to these drives and this configuration.
    serials: serial numbers of the drives that answered, in the order of the joints."""
    c, found = robot.configuration, robot.identified
    against = objections(found, c, robot.urdf, dict(zip(c.joint_names, serials, strict=True)))
    text = "; ".join(against) or f"{c.identified} is of these drives"
    return Check(name="identification", passed=not against, text=text)


def check_parameters(robot: Robot) -> Check:
    """Arming check of gaps, friction and thresholds: identified, or known otherwise. Loops over
    the links do not need them, since friction is identified with these loops closed."""
    missing = parameters_missing(robot.identified, robot.configuration, robot.urdf)
    text = parameters_known(robot.identified, robot.configuration)
    if missing:
        text = (
            "; ".join(missing) + "; what was identified since is used when the files are read anew"
        )
    return Check(name="parameters", passed=not missing, text=text)


def build_estimator(c: Configuration, model: Model) -> Estimator:
    """Estimator: the complete chain from samples to contact."""
    return Estimator(
        model,
        build_transmission(c),
        c.estimator,
        Thresholds(
            contact=row(c, lambda j: j.thresholds.contact),
            collision=row(c, lambda j: j.thresholds.collision),
            per_speed=row(c, lambda j: j.thresholds.per_speed),
            least_share=row(c, lambda j: j.least_share),
        ),
        c.period_s,
    )


def build_transmission(c: Configuration) -> Transmission:
    """Gears, gaps, rotors and friction as arrays (n,)."""
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
        least_stiction=row(c, lambda j: stiction_range(j.friction.stiction)[0]),
        most_stiction=row(c, lambda j: stiction_range(j.friction.stiction)[1]),
        load_friction=row(c, lambda j: load_range(j.friction.load)[0]),
        load_friction_error=row(c, lambda j: load_range(j.friction.load)[1]),
        contact_stiffness=row(c, lambda j: j.gap_spring.stiffness),
        contact_damping=row(c, lambda j: j.gap_spring.damping),
        sign_width=c.estimator.sign_width,
    )


def build_fault_detector(c: Configuration) -> FaultDetector:
    """Detector of faults, with the bounds and tolerances of the configuration."""
    s = c.supervisor
    not_sensing_ticks = tolerated_ticks(c.period_s)
    tolerated = DetectorSettings(c.period_s, s.stale_ticks, s.overrun_ticks, not_sensing_ticks)
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
        deviation=following_margin(c), current=bounds.current, lag_s=c.control.drive_lag_ms / 1000.0
    )
    return FaultDetector(
        c.joint_names,
        tolerated,
        Plausibility(c.joint_names, bounds),
        Following(following, c.period_s),
        IgnoredSetpoints(bounds.current),
    )


def following_margin(c: Configuration) -> Vector:
    """Permitted deviation of the motors from their setpoints (n,) [rad/s]."""
    return c.supervisor.following_margin * row(c, lambda j: j.limits.velocity)


def build_controller(robot: Robot, *, links_trusted: bool) -> Controller:
    """Controller: modes and reactions over `build_motion`."""
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
        assists=c.admittance.assist,
        probes=c.admittance.probe,
    )
    t = build_transmission(c)
    coulomb = largest_coulomb(t, row(c, lambda j: j.wiring.max_current_A))
    witness = HandWitness(coulomb, t.motor_viscous + t.link_viscous)
    return Controller(tuning, build_motion(robot, links_trusted=links_trusted), witness)


def largest_coulomb(t: Transmission, max_current: Vector) -> Vector:
    """Coulomb friction (n,) [Nm] at the largest torque of each motor, from its largest current [A]:
    an external torque beyond it cannot be identified friction."""
    load = t.load_friction + t.load_friction_error
    return t.engaged_coulomb + load * t.torque_constant * max_current


def build_motion(robot: Robot, *, links_trusted: bool) -> Motion:
    """Motion: trajectory, admittance, limits. Position loops are closed over the links only if
    these are trusted."""
    c = robot.configuration
    manner = MotionSettings(
        position_gain=c.control.position_gain,
        return_velocity=c.admittance.return_velocity,
        retract_velocity=c.reactions.retract_velocity,
        retract_distance=c.reactions.retract_distance,
        release=ReleaseSettings(
            velocity=c.reactions.release_velocity,
            distance=c.reactions.release_distance,
            ahead=AHEAD_SHARE * following_margin(c),
        ),
    )
    law = AdmittanceLaw(
        virtual_mass_s=virtual_mass_of(c), velocity=np.full(len(c.joints), c.admittance.velocity)
    )
    motion = Motion(
        manner=manner,
        limits=limits_of(c),
        law=law,
        gains=Gains(row(c, lambda j: j.admittance_gain)),
        follower=Follower(PathPoint(path_of(c, robot.trajectory)), c.trajectory.ramp_s),
        blind=not links_trusted,
        walls=build_walls(robot),
        model=robot.model,
    )
    if links_trusted:
        motion.guidance.change(guide_of(c))
    return motion


def build_walls(robot: Robot) -> Walls | None:
    """Walls from shapes and surroundings; None without shapes."""
    if robot.walls is None:
        return None
    limits, joints = limits_of(robot.configuration), robot.configuration.joint_names
    clearance = clearance_of(robot.walls, robot.model.bodies(), joints)
    margin = robot.walls.shapes.margin
    return Walls(clearance, limits.acceleration, limits.reaction_s, margin)
