"""Schema of `config.yaml`: types and bounds of each field; rules over several are in `checks`."""

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
from drivers.settings import Name, Settings
from drivers.wiring import JointWiring
from estimator.body_inertia import BodyInertia
from estimator.payload import Coordinate, Edge, Mass
from estimator.settings import EstimatorSettings
from estimator.thresholds import LEAST_SHARE

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Ticks = Annotated[int, Meta(ge=1, le=1000)]
Speed = Annotated[float, Meta(gt=0, le=2)]  # [rad/s]
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
    # share of the Coulomb friction that near rest keeps the sign of the last motion (1: it sticks);
    # left out: any from 0 to 1
    stiction: Annotated[float, Meta(ge=0, le=1)] | None = None
    # Coulomb friction per Nm that the gear transmits, at least and at most: 0.05 to 0.3 for gears
    # of 95 to 75 % efficiency; left out: it is learned from none on
    load: tuple[LoadShare, LoadShare] | None = None

    def __post_init__(self) -> None:
        if self.load is not None and self.load[0] > self.load[1]:
            raise ValueError(
                f"load is [{self.load[0]:g}, {self.load[1]:g}]: the least, then the most"
            )


class GapSpring(Settings, frozen=True):
    """K_phi_p [Nm/rad] and K_phi_d [Nm s/rad] of eq. (5): a correction from a fit, not the
    stiffness of the gear, and zero unless the identification found that it helps."""

    stiffness: NotNegative = 0.0
    damping: NotNegative = 0.0


class Levels(Settings, frozen=True):
    """Residuals [Nm] above which a joint counts as touched (`contact`) or hit (`collision`)."""

    contact: Positive
    collision: Positive
    per_speed: NotNegative = 0.0  # both grow by this times the motor's speed [Nm s/rad]
    # Contact level that learning leaves at least, a fifth of `contact` to all [Nm]; by default all
    # where `known` states it, else a fifth.
    least: Positive | None = None


class JointLimits(Settings, frozen=True):
    """Limits of all commands, at the link: rad, rad/s, rad/s2."""

    lower: float  # [rad]
    upper: float  # [rad]
    velocity: Annotated[float, Meta(gt=0, le=20)]  # [rad/s]
    acceleration: Annotated[float, Meta(gt=0, le=500)]  # [rad/s2]
    quick_stop: Annotated[float, Meta(gt=0, le=1000)]  # the drive's own deceleration


ArmingStep = Literal["wiring", "gap", "masses", "friction", "thresholds"]
"""Step of `contactd identify` whose values arming requires, in the order of their dependence."""


class Joint(Settings, frozen=True):
    """One joint: its drive, its transmission, its levels and limits."""

    name: Name
    wiring: JointWiring
    torque_constant: Positive  # K_c [Nm at the link per A of motor current]
    rotor_inertia: NotNegative  # B, reflected to the link [kg m2]
    half_gap: Annotated[float, Meta(ge=0, le=0.5)]  # alpha [rad]
    friction: Friction
    thresholds: Levels
    limits: JointLimits
    admittance_gain: Annotated[float, Meta(ge=0, le=MAX_GAIN)]  # K_a [rad/s per Nm]
    virtual_mass_s: VirtualMass | None = None  # instead of `admittance.virtual_mass_s`
    gap_spring: GapSpring = GapSpring()
    # Body that the joint moves, up to the next joints, in place of the URDF's.
    body: BodyInertia | None = None
    # Steps of `contactd identify` that this joint does not need, each with the source of its
    # values: `{gap: "data sheet: none"}`. `thresholds` so stated win over identified ones. Not for
    # a copy for another arm.
    known: dict[ArmingStep, Name] = msgspec.field(default_factory=dict)
    # State of the joint when the daemon ends: `hold` leaves the drive in quick stop,
    # where it holds by itself; `brake` and `limp` switch its torque off.
    end: Literal["hold", "brake", "limp"] = "hold"

    @property
    def least_share(self) -> float:
        """Share of the contact level that learning leaves at least: a level stated by a person is
        lowered by a person only."""
        if self.thresholds.least is None:
            return 1.0 if "thresholds" in self.known else LEAST_SHARE
        return min(max(self.thresholds.least / self.thresholds.contact, LEAST_SHARE), 1.0)


class PositionLoop(Settings, frozen=True):
    """Loop on link position that turns a reference into a target velocity."""

    # Quiet up to 8 /s, cycles in the gap at 40 /s.
    position_gain: Annotated[float, Meta(gt=0, le=15)] = 8.0
    # Time constant of the drive's velocity loop, with which a joint follows a new setpoint. Braking
    # before a joint limit begins that much earlier.
    drive_lag_ms: Annotated[float, Meta(ge=0, le=100)] = 10.0


class Admittance(Settings, frozen=True):
    """Admittance, eq. (15), on the thresholded residual, and its bounds."""

    quiet_s: Annotated[float, Meta(ge=0.1, le=60)] = 2.0  # without a contact, until the arm goes on
    virtual_mass_s: VirtualMass = 0.05  # time constant of the velocity; 0 is none [s]
    velocity: Speed = 0.5  # [rad/s]
    max_duration_s: Annotated[float, Meta(gt=0, le=3600)] = 120.0
    max_excursion: Annotated[float, Meta(gt=0, le=6.3)] = 1.5  # of all contacts since `arm` [rad]
    after_quiet: AfterQuiet = AfterQuiet.RESUME  # how an interrupted trajectory goes on
    # before it goes on, swing by some 2 mm to find a hand that rests; not with quiet_s below 1.9
    probe: bool = True
    # a hand that leads pushes less; so does a load or a cable that pulls, which goes further
    assist: bool = False
    return_velocity: Speed = 0.2  # with `after_quiet: return` [rad/s]
    # of the guide: its axes are those of the `tool`, of the `base`, or of a link of the URDF
    frame: Frame = TOOL
    free: Axes = ()  # as is each that is not named; with nothing held or damped there is no guide
    damped: Axes = ()  # at a fifth of the speed
    held: Axes = ()
    stiff: Axes = ()  # held, and taken back to where the guide began
    redundant: Redundant = "free"  # joints that can move where the frame stands


class ReactionSettings(Settings, frozen=True):
    """Reactions to contact and collision. While the arm is not armed, a contact is only reported,
    and a collision stops it, unless `release` or `quick_stop` is chosen for it."""

    contact: ContactReaction = ContactReaction.ADMITTANCE  # beyond `thresholds.contact`
    collision: ContactReaction = ContactReaction.RELEASE  # beyond `thresholds.collision`
    retract_distance: Annotated[float, Meta(gt=0, le=1)] = 0.15  # of the furthest joint [rad]
    retract_velocity: Speed = 0.4  # [rad/s]
    release_distance: Annotated[float, Meta(gt=0, le=1)] = 0.3  # of each joint at most [rad]
    release_velocity: Annotated[float, Meta(gt=0, le=0.5)] = 0.32  # of each joint [rad/s]


class Sinusoid(Settings, frozen=True):
    """Motion q = q0 + amplitude * sin(2 pi frequency t) around the position q0 at its start."""

    amplitude: Annotated[float, Meta(gt=0, le=3.2)]  # [rad]
    frequency_Hz: Annotated[float, Meta(gt=0, le=5)]


class Trajectory(Settings, frozen=True):
    """Trajectory that `contactctl start` runs, none by default; a joint that is not named holds."""

    sinusoids: dict[str, Sinusoid] = msgspec.field(default_factory=dict)  # by joint
    file: Name | None = None  # instead: a CSV file, relative to the configuration
    from_here: bool = False  # run the file from any pose of the arm, as sinusoids are
    ramp_s: Annotated[float, Meta(ge=0.1, le=30)] = 2.0  # from standstill to full speed


class Stream(Settings, frozen=True):
    """Stream of targets that a client sends while the arm moves (following.md)."""

    # How it goes on after a contact: `hold` waits until the stream is near, or is asked for anew.
    after_contact: AfterContact = AfterContact.HOLD
    reach: Annotated[float, Meta(gt=0, le=3.2)] = 0.5  # furthest target that the arm goes to [rad]
    join_velocity: Speed = 0.2  # of the way to the stream [rad/s]


class FaultSettings(Settings, frozen=True):
    """Bounds and times beyond which something is a fault (faults.md)."""

    stale_ticks: Ticks = 3  # ticks in a row without a drive's TPDOs, or with a disturbed bus
    overrun_ticks: Ticks = 5  # deadlines missed in a row
    # Until every drive is in operation, else off.
    enable_timeout_s: Annotated[float, Meta(gt=0, le=60)] = 3.0
    # Time for the arm to come to rest, otherwise a fault. A daemon that ends waits this long, and
    # two seconds for the drives; it must end before systemd kills it (TimeoutStopSec=30).
    stop_timeout_s: Annotated[float, Meta(gt=0, le=25)] = 3.0
    saturated_ticks: Ticks = 20  # ticks in a row at the current limit
    # Margins by which a measurement may exceed the joint's own capability and still be plausible.
    position_margin: Annotated[float, Meta(gt=0, le=0.5)] = 0.05  # noise, a bent gear, a push [rad]
    speed_margin: Annotated[float, Meta(gt=1, le=10)] = 2.0  # times limits.velocity
    # Largest deviation of a motor's speed from its setpoints, over limits.velocity, while its
    # current does not push it there. More for a soft velocity loop (porting.md, step 8); 10: never.
    following_margin: Annotated[float, Meta(gt=0, le=10)] = 0.2
    residual_margin: Annotated[float, Meta(gt=1, le=100)] = 4.0  # times thresholds.collision


ProfileT = TypeVar("ProfileT", bound=DriveProfile)
NO_PAYLOAD = "none"
"""Not the name of a payload: `contactctl payload none` takes it off."""


class PayloadEntry(Settings, frozen=True):
    """Payload that the hand may carry, for `contactctl payload NAME`. Without a place it is at the
    tool point, which `contactctl status` shows."""

    mass: Mass  # [kg]
    # centre of mass in the frame of the URDF's last link [m]
    com: tuple[Coordinate, Coordinate, Coordinate] | None = None
    # edges of a box about it, along that link's axes, which walls keep off [m]; none: not known
    box: tuple[Edge, Edge, Edge] | None = None


JointPosition = Annotated[float, Meta(ge=-100, le=100)]  # of a link [rad]
Pose = Annotated[dict[Name, JointPosition], Meta(min_length=1)]
"""Positions by joint [rad]; joints that are not named stay where they are."""


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
    identified: Name = "identified.yaml"  # beside the configuration; need not exist
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
        """Contact level of each joint that learning leaves at least [Nm]: all, if none learns."""
        learns = self.estimator.learning
        return [j.thresholds.contact * (j.least_share if learns else 1.0) for j in self.joints]

    @property
    def bodies(self) -> dict[str, BodyInertia]:
        """Bodies that replace those of the URDF, by joint."""
        return {joint.name: joint.body for joint in self.joints if joint.body is not None}

    @property
    def make(self) -> Make:
        """Make of its drives."""
        return make_of(next(iter(self.drives.values())))

    @property
    def joint_drives(self) -> tuple[Drive[Any], ...]:
        """The drive of each joint, in the same order, all of one make."""
        return tuple(drive_of(joint, self.drives[joint.wiring.profile]) for joint in self.joints)


def drive_of(joint: Joint, profile: ProfileT) -> Drive[ProfileT]:
    """Drive of a joint, of this kind."""
    limits, play = joint.limits, 2.0 * joint.half_gap
    return Drive(joint.name, joint.wiring, profile, limits.velocity, limits.quick_stop, play)


def frames_of(c: Configuration) -> tuple[FrameLoad, ...]:
    """Every periodic frame of the arm."""
    return c.make.frames(c.joint_drives, c.period_s, c.bus.master_node)
