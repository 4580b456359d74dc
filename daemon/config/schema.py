"""Schema of `config.yaml`: type and bounds of each field; `checks` has the rules across fields."""

from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import Meta

from daemon.modes.contact_reactions import AfterQuiet, ContactReaction
from daemon.motion.target_stream import AfterContact
from daemon.protocol.bounds import MAX_GAIN
from daemon.protocol.guide import TOOL, Axes, Frame, Redundant
from drivers.can.load import FrameLoad
from drivers.can.settings import BusSettings
from drivers.drive import Drive
from drivers.makes import DriveProfile, Make, make_of
from drivers.settings import RAD, RAD_S, RAD_S2, Name, Settings
from drivers.wiring import JointWiring
from estimator.body_inertia import BodyInertia
from estimator.payload import Coordinate, Edge, Mass
from estimator.settings import EstimatorSettings
from estimator.thresholds import LEAST_SHARE

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Ticks = Annotated[int, Meta(ge=1, le=1000)]
Speed = Annotated[float, Meta(gt=0, le=2, extra=RAD_S)]
LoadShare = Annotated[float, Meta(ge=0, le=0.5)]
VirtualMass = Annotated[float, Meta(ge=0, le=1)]  # time constant of the velocity; 0 is none [s]


class Friction(Settings, frozen=True):
    """Coefficients of eq. (6), at the link side; Coulomb in Nm, viscous in Nm s/rad."""

    motor_coulomb: NotNegative = 0.0
    motor_viscous: NotNegative = 0.0
    link_coulomb: NotNegative = 0.0
    link_viscous: NotNegative = 0.0
    gap_coulomb: NotNegative = 0.0
    gap_viscous: NotNegative = 0.0
    # share of the Coulomb friction that keeps the sign of the last motion near rest (1: it sticks);
    # if left out: unknown, 0 to 1
    stiction: Annotated[float, Meta(ge=0, le=1)] | None = None
    # Coulomb friction per Nm that the gear transmits, minimum and maximum: 0.05 to 0.3 for gears
    # of 95 to 75 % efficiency; if left out: learned, starting at 0
    load: tuple[LoadShare, LoadShare] | None = None

    def __post_init__(self) -> None:
        if self.load is not None and self.load[0] > self.load[1]:
            raise ValueError(
                f"load is [{self.load[0]:g}, {self.load[1]:g}]: must be [minimum, maximum]"
            )


class GapSpring(Settings, frozen=True):
    """K_phi_p [Nm/rad] and K_phi_d [Nm s/rad] of eq. (5): a fitted correction, not the stiffness
    of the gear; zero unless the identification found that it improves the fit."""

    stiffness: NotNegative = 0.0
    damping: NotNegative = 0.0


class Levels(Settings, frozen=True):
    """Residuals [Nm] above which a joint counts as touched (`contact`) or hit (`collision`)."""

    contact: Positive
    collision: Positive
    per_speed: NotNegative = 0.0  # both grow by this times the motor's speed [Nm s/rad]
    # Lowest contact level that learning may set, from a fifth of `contact` to all [Nm]; default:
    # all if `known` states thresholds, else a fifth.
    least: Positive | None = None


class JointLimits(Settings, frozen=True):
    """Limits of every command, at the link: rad, rad/s, rad/s2."""

    lower: float  # [rad]
    upper: float  # [rad]
    velocity: Annotated[float, Meta(gt=0, le=20, extra=RAD_S)]
    acceleration: Annotated[float, Meta(gt=0, le=500, extra=RAD_S2)]
    quick_stop: Annotated[float, Meta(gt=0, le=1000)]  # the drive's own deceleration


ArmingStep = Literal["wiring", "gap", "masses", "friction", "thresholds"]
"""Step of `contactd identify` whose values arming requires; each depends on those before it."""


class Joint(Settings, frozen=True):
    """One joint: its drive, transmission, contact levels and limits."""

    name: Name
    wiring: JointWiring
    torque_constant: Positive  # K_c [Nm at the link per A of motor current]
    rotor_inertia: NotNegative  # B, reflected to the link [kg m2]
    half_gap: Annotated[float, Meta(ge=0, le=0.5, extra=RAD)]  # alpha
    friction: Friction
    thresholds: Levels
    limits: JointLimits
    admittance_gain: Annotated[float, Meta(ge=0, le=MAX_GAIN)]  # K_a [rad/s per Nm]
    virtual_mass_s: VirtualMass | None = None  # instead of `admittance.virtual_mass_s`
    gap_spring: GapSpring = GapSpring()
    # Body between this joint and the next ones, in place of the URDF's.
    body: BodyInertia | None = None
    # Steps of `contactd identify` that this joint does not need, each with the source of its
    # values: `{gap: "data sheet: none"}`. `thresholds` stated here override identified ones. Do
    # not copy to another arm.
    known: dict[ArmingStep, Name] = msgspec.field(default_factory=dict)
    # State of the joint after the daemon exits: `hold` leaves the drive in quick stop,
    # where it holds by itself; `brake` and `limp` switch its torque off.
    end: Literal["hold", "brake", "limp"] = "hold"

    @property
    def least_share(self) -> float:
        """Lowest share of the contact level that learning may set. A level stated by a person is
        not lowered by learning."""
        if self.thresholds.least is None:
            return 1.0 if "thresholds" in self.known else LEAST_SHARE
        return min(max(self.thresholds.least / self.thresholds.contact, LEAST_SHARE), 1.0)


class PositionLoop(Settings, frozen=True):
    """Loop on link position, from reference position to target velocity."""

    # Smooth up to 8 /s; limit cycle in the gap at 40 /s.
    position_gain: Annotated[float, Meta(gt=0, le=15)] = 8.0
    # Time constant with which the drive's velocity loop follows a new setpoint. Braking before a
    # joint limit begins that much earlier.
    drive_lag_ms: Annotated[float, Meta(ge=0, le=100)] = 10.0


class Admittance(Settings, frozen=True):
    """Admittance, eq. (15), on the thresholded residual, and its bounds."""

    quiet_s: Annotated[float, Meta(ge=0.1, le=60)] = 2.0  # without a contact, before resuming
    virtual_mass_s: VirtualMass = 0.05  # time constant of the velocity; 0 is none [s]
    velocity: Speed = 0.5
    max_duration_s: Annotated[float, Meta(gt=0, le=3600)] = 120.0
    max_excursion: Annotated[float, Meta(gt=0, le=6.3, extra=RAD)] = 1.5  # all contacts since `arm`
    after_quiet: AfterQuiet = AfterQuiet.RESUME  # continuation of an interrupted trajectory
    # before resuming, swing by some 2 mm to detect a resting hand; not with quiet_s below 1.9
    probe: bool = True
    # less effort for a leading hand; a load or a cable that pulls also moves the arm further
    assist: bool = False
    return_velocity: Speed = 0.2  # with `after_quiet: return`
    # of the guide: its axes are those of the `tool`, of the `base`, or of a link of the URDF
    frame: Frame = TOOL
    free: Axes = ()  # default of axes not named; without held or damped axes there is no guide
    damped: Axes = ()  # at a fifth of the speed
    held: Axes = ()
    stiff: Axes = ()  # held, and returned to where the guide began
    redundant: Redundant = "free"  # joint motion that leaves the frame at rest


class ReactionSettings(Settings, frozen=True):
    """Reactions to contact and collision. While the arm is not armed, a contact is only reported,
    and a collision stops it, unless its reaction is `release` or `quick_stop`."""

    contact: ContactReaction = ContactReaction.ADMITTANCE  # beyond `thresholds.contact`
    collision: ContactReaction = ContactReaction.RELEASE  # beyond `thresholds.collision`
    retract_distance: Annotated[float, Meta(gt=0, le=1, extra=RAD)] = 0.15  # of the furthest joint
    retract_velocity: Speed = 0.4
    release_distance: Annotated[float, Meta(gt=0, le=1, extra=RAD)] = 0.3  # of each joint at most
    release_velocity: Annotated[float, Meta(gt=0, le=0.5, extra=RAD_S)] = 0.32  # of each joint


class Sinusoid(Settings, frozen=True):
    """Motion q = q0 + amplitude * sin(2 pi frequency t) around the position q0 at its start."""

    amplitude: Annotated[float, Meta(gt=0, le=3.2, extra=RAD)]
    frequency_Hz: Annotated[float, Meta(gt=0, le=5)]


class Trajectory(Settings, frozen=True):
    """Trajectory that `contactctl start` runs, none by default; joints not named hold."""

    sinusoids: dict[str, Sinusoid] = msgspec.field(default_factory=dict)  # by joint
    file: Name | None = None  # alternative: a CSV file, relative to the configuration
    from_here: bool = False  # start the file from the present pose, as sinusoids do
    ramp_s: Annotated[float, Meta(ge=0.1, le=30)] = 2.0  # from standstill to full speed


class Stream(Settings, frozen=True):
    """Stream of targets that a client sends while the arm moves (following.md)."""

    # After a contact: `hold` waits until the stream is near, or is requested again.
    after_contact: AfterContact = AfterContact.HOLD
    reach: Annotated[float, Meta(gt=0, le=3.2, extra=RAD)] = 0.5  # accepted distance of targets
    join_velocity: Speed = 0.2  # of the approach to the stream


class FaultSettings(Settings, frozen=True):
    """Bounds and timeouts of fault detection (faults.md)."""

    stale_ticks: Ticks = 3  # consecutive ticks without a drive's TPDOs, or with a disturbed bus
    overrun_ticks: Ticks = 5  # consecutive missed deadlines
    # Until every drive is in operation, else off.
    enable_timeout_s: Annotated[float, Meta(gt=0, le=60)] = 3.0
    # Time for the arm to come to rest, otherwise a fault. On exit the daemon waits this long, and
    # two seconds for the drives; it must end before systemd kills it (TimeoutStopSec=30).
    stop_timeout_s: Annotated[float, Meta(gt=0, le=25)] = 3.0
    saturated_ticks: Ticks = 20  # consecutive ticks at the current limit
    # Margins by which a plausible measurement may exceed the joint's own capability.
    position_margin: Annotated[float, Meta(gt=0, le=0.5, extra=RAD)] = 0.05  # noise, bending, push
    speed_margin: Annotated[float, Meta(gt=1, le=10)] = 2.0  # times limits.velocity
    # Largest deviation of a motor's speed from its setpoints, over limits.velocity, while its
    # current does not push it there. More for a soft velocity loop (porting.md, step 8); 10: never.
    following_margin: Annotated[float, Meta(gt=0, le=10)] = 0.2
    residual_margin: Annotated[float, Meta(gt=1, le=100)] = 4.0  # times thresholds.collision


ProfileT = TypeVar("ProfileT", bound=DriveProfile)
NO_PAYLOAD = "none"
"""Word that is no payload's name: `contactctl payload none` removes the payload."""


class PayloadEntry(Settings, frozen=True):
    """Payload that the hand may carry, for `contactctl payload NAME`. Without `com` it is at the
    tool point, which `contactctl status` shows."""

    mass: Mass  # [kg]
    # centre of mass in the frame of the URDF's last link [m]
    com: tuple[Coordinate, Coordinate, Coordinate] | None = None
    # edges of a box centred at `com`, along that link's axes, guarded by walls [m]; none: unknown
    box: tuple[Edge, Edge, Edge] | None = None


JointPosition = Annotated[float, Meta(ge=-100, le=100, extra=RAD)]  # of a link
Pose = Annotated[dict[Name, JointPosition], Meta(min_length=1)]
"""Positions by joint [rad]; joints not named stay where they are."""


class Configuration(Settings, frozen=True):
    """One arm, as `config.yaml` describes it."""

    version: Literal[1]  # of this format
    name: Name
    urdf: Name  # path, relative to the configuration
    period_ms: Annotated[int, Meta(ge=1, le=100)]  # of the loop, T, and of SYNC
    bus: BusSettings
    # Each under a name of your own, to which `wiring.profile` of a joint refers.
    drives: Annotated[dict[str, DriveProfile], Meta(min_length=1)]
    joints: Annotated[list[Joint], Meta(min_length=1, max_length=32)]
    identified: Name = "identified.yaml"  # relative to the configuration; need not exist
    estimator: EstimatorSettings = EstimatorSettings()
    control: PositionLoop = PositionLoop()
    admittance: Admittance = Admittance()
    reactions: ReactionSettings = ReactionSettings()
    trajectory: Trajectory = Trajectory()
    stream: Stream = Stream()
    supervisor: FaultSettings = FaultSettings()
    payloads: dict[Name, PayloadEntry] = msgspec.field(default_factory=dict)  # by name
    # By name, for `contactctl go NAME`: positions of the links by joint [rad]; others stay where
    # they are. `contactctl home` goes to `home`.
    poses: dict[Name, Pose] = msgspec.field(default_factory=dict)

    @property
    def period_s(self) -> float:
        """Period T [s]."""
        return self.period_ms / 1000.0

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints, in the order of every vector."""
        return [joint.name for joint in self.joints]

    @property
    def least_levels(self) -> list[float]:
        """Lowest contact level that learning may set for each joint [Nm]: the level, if off."""
        learns = self.estimator.learning
        return [j.thresholds.contact * (j.least_share if learns else 1.0) for j in self.joints]

    @property
    def bodies(self) -> dict[str, BodyInertia]:
        """Bodies that replace the URDF's, by joint."""
        return {joint.name: joint.body for joint in self.joints if joint.body is not None}

    @property
    def make(self) -> Make:
        """Make of the drives."""
        return make_of(next(iter(self.drives.values())))

    @property
    def joint_drives(self) -> tuple[Drive[Any], ...]:
        """Drive of each joint, in the order of the joints; all are of one make."""
        return tuple(drive_of(joint, self.drives[joint.wiring.profile]) for joint in self.joints)


def drive_of(joint: Joint, profile: ProfileT) -> Drive[ProfileT]:
    """Drive of a joint with this profile."""
    limits, play = joint.limits, 2.0 * joint.half_gap
    return Drive(joint.name, joint.wiring, profile, limits.velocity, limits.quick_stop, play)


def frames_of(c: Configuration) -> tuple[FrameLoad, ...]:
    """Every periodic frame of the arm."""
    return c.make.frames(c.joint_drives, c.period_s, c.bus.master_node)
