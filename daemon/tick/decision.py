"""Settings, inputs and outcome of the controller's decisions: plain data."""

from dataclasses import dataclass

from common.arrays import Vector
from daemon.faults.finding import Finding
from daemon.modes.contact_reactions import AfterQuiet, Reactions
from daemon.motion.admittance import AllowanceSettings
from daemon.motion.hand_witness import IndependentResidual, agreed, beyond_stated
from drivers.api import DriveCondition, DriveStatus, PowerTarget
from estimator.contact import dead_band


@dataclass(frozen=True, slots=True)
class ControllerSettings:
    """Settings of the controller, from the configuration."""

    joints: tuple[str, ...]
    ends: tuple[str, ...]  # hold, brake or limp, per joint
    reactions: Reactions
    quiet_s: float
    after_quiet: AfterQuiet
    bounds: AllowanceSettings
    enable_timeout_s: float
    stop_timeout_s: float
    assists: bool = False  # a hand that leads
    probes: bool = True  # for a resting hand, before a trajectory resumes


@dataclass(frozen=True, slots=True)
class ControlInput:
    """Inputs of a decision. Vectors of shape (n,), SI at the link."""

    q: Vector  # measured link position
    motor_velocity: Vector
    residual: Vector  # [Nm]
    thresholded: Vector  # thresholded residual [Nm]
    touched: str  # description of the contact that lasts; empty without one
    hit: str  # description of the collision that lasts, likewise
    drives: tuple[DriveStatus, ...]
    findings: tuple[Finding, ...]
    age_s: Vector | None = None  # of q; None where every sample came in time
    recent: bool = True  # every sample came in this tick, or just before
    struck: bool = False  # a collision began in this tick
    sure: bool = True  # every joint senses, and no residual has just restarted
    load: str = ""  # description of a load at the hand that explains the whole residual
    too_often: str = ""  # description of contacts in doubt that recur at one place
    play: Vector | float = 0.0  # free travel of links down and up in their gaps, (2, n) [rad]
    # Residual that may move the arm; None: the thresholded residual.
    independent: IndependentResidual | None = None

    @property
    def operating(self) -> tuple[bool, ...]:
        """True for each drive that follows its setpoints."""
        return tuple([drive.condition is DriveCondition.OPERATING for drive in self.drives])

    @property
    def avoided(self) -> Vector:
        """Thresholded residual (n,) [Nm] for retracting and releasing, without what is due to
        learning alone."""
        return self.thresholded if self.independent is None else beyond_stated(self.independent)

    @property
    def opposing(self) -> Vector:
        """Residual (n,) [Nm] beyond the configured level, which stops a retracting arm."""
        if self.independent is None:
            return self.thresholded
        return dead_band(self.independent.agreed, self.independent.configured)

    @property
    def pressing(self) -> Vector:
        """Residual (n,) [Nm] beyond the stated level that still presses a releasing joint. Learned
        friction is used, as without it a clamp seems looser than it is, but what is due to learning
        alone is left out."""
        if self.independent is None:
            return self.thresholded
        pressing = dead_band(self.residual, self.independent.stated)
        return agreed(pressing, self.independent.agreed)


@dataclass(frozen=True, slots=True)
class Decision:
    """Commands to the drives, and the reference behind them; vectors of shape (n,)."""

    power: tuple[PowerTarget, ...]
    reset: bool  # request a fault reset from drives in fault
    velocity: Vector  # target velocity [rad/s]
    reference: Vector  # desired q [rad]
