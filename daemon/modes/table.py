"""Motion modes and the one table of transitions between them. Pure data: no I/O, no time.

docs/modes.md is written from this file by `make reference`, the comments on modes and events too.

`armed` is a permission beside the mode: only when armed may a contact lead to admittance or make
the arm retract.
"""

from enum import StrEnum


class Mode(StrEnum):
    """Motion mode of the arm."""

    # The daemon energises nothing. A joint whose `end` is `hold` stays in quick stop, where its
    # drive holds it; `brake` and `limp` have no torque.
    OFF = "off"
    # The drives are on their way to operation enabled. No motion.
    ENABLING = "enabling"
    # Energised; a position loop keeps the arm where it stood.
    HOLDING = "holding"
    # The trajectory, from where the arm stood.
    TRACKING = "tracking"
    # The arm moves the way it is pushed, eq. (15) of the paper, within bounds.
    ADMITTANCE = "admittance"
    # Backs away from a hand, by `reactions.retract_distance` the way it was pushed, and
    # waits there until it is quiet.
    RETRACTING = "retracting"
    # Returns slowly, in a straight line through joint space, to where a contact took it from its
    # trajectory, or only as far as the trajectory needs to stay within the joint limits.
    RETURNING = "returning"
    # Lets go after a collision: the joints in contact move slowly the way they are pushed, at
    # `reactions.release_velocity`, by `reactions.release_distance` at most.
    RELEASING = "releasing"
    # Decelerates within its limits.
    STOPPING = "stopping"
    # Quick stop of all drives, latched until `reset`.
    FAULTED = "faulted"


class Event(StrEnum):
    """Event that may change the mode: a command of a person, or what happens to the arm."""

    ENABLE = "enable"  # a person: energise the drives
    START = "start"  # a person: run a trajectory, or continue the paused one
    PAUSE = "pause"  # a person: halt the trajectory; `start` continues it
    # the client that attended the motion is gone, or silent: halt the motion and forget it
    ABANDON = "abandon"
    STOP = "stop"  # a person: stop
    DISARM = "disarm"  # a person: stop yielding
    DISABLE = "disable"  # a person, or the end of the program: switch the drives off
    RESET = "reset"  # a person: the fault has been dealt with
    ENERGISED = "energised"  # every drive reports operation enabled
    STANDSTILL = "standstill"  # no joint moves, and no setpoint commands motion
    END = "end"  # the trajectory is complete
    TOUCH = "touch"  # a contact to yield to
    RETRACT = "retract"  # a contact to back away from
    RELEASE = "release"  # a collision to release
    # a contact to stop at; pushed against while retracting; the end of a release
    HALT = "halt"
    RESUME = "resume"  # quiet, and the trajectory fits from here
    RETURN = "return"  # quiet, and the trajectory resumes where it was left, or where it fits
    # quiet, and nothing to resume, or it fits nowhere within the joint limits
    SETTLE = "settle"
    ARRIVED = "arrived"  # back where the trajectory resumes
    BOUND = "bound"  # contacts led the arm for longer or further than allowed
    TIMEOUT = "timeout"  # enabling, stopping or returning took too long
    DOUBT = "doubt"  # a condition at which the arm holds
    FAULT = "fault"  # a condition, or a contact, at which all drives quick-stop


_M, _E = Mode, Event

TRANSITIONS: dict[tuple[Mode, Event], Mode] = {
    (_M.OFF, _E.ENABLE): _M.ENABLING,
    (_M.OFF, _E.DISABLE): _M.OFF,
    (_M.OFF, _E.STOP): _M.OFF,
    (_M.OFF, _E.DISARM): _M.OFF,
    (_M.OFF, _E.FAULT): _M.FAULTED,
    (_M.ENABLING, _E.ENERGISED): _M.HOLDING,
    (_M.ENABLING, _E.TIMEOUT): _M.OFF,
    (_M.ENABLING, _E.STOP): _M.OFF,
    (_M.ENABLING, _E.DISABLE): _M.OFF,
    (_M.ENABLING, _E.DISARM): _M.ENABLING,
    (_M.ENABLING, _E.FAULT): _M.FAULTED,
    (_M.HOLDING, _E.START): _M.TRACKING,
    (_M.HOLDING, _E.PAUSE): _M.HOLDING,
    (_M.HOLDING, _E.ABANDON): _M.HOLDING,
    (_M.HOLDING, _E.STOP): _M.STOPPING,
    (_M.HOLDING, _E.DISARM): _M.HOLDING,
    (_M.HOLDING, _E.DISABLE): _M.OFF,
    (_M.HOLDING, _E.TOUCH): _M.ADMITTANCE,
    (_M.HOLDING, _E.RETRACT): _M.RETRACTING,
    (_M.HOLDING, _E.RELEASE): _M.RELEASING,
    (_M.HOLDING, _E.HALT): _M.HOLDING,
    (_M.HOLDING, _E.DOUBT): _M.HOLDING,
    (_M.HOLDING, _E.FAULT): _M.FAULTED,
    (_M.TRACKING, _E.END): _M.HOLDING,
    (_M.TRACKING, _E.PAUSE): _M.STOPPING,
    (_M.TRACKING, _E.ABANDON): _M.STOPPING,
    (_M.TRACKING, _E.STOP): _M.STOPPING,
    (_M.TRACKING, _E.DISARM): _M.TRACKING,
    (_M.TRACKING, _E.DISABLE): _M.STOPPING,
    (_M.TRACKING, _E.TOUCH): _M.ADMITTANCE,
    (_M.TRACKING, _E.RETRACT): _M.RETRACTING,
    (_M.TRACKING, _E.RELEASE): _M.RELEASING,
    (_M.TRACKING, _E.HALT): _M.STOPPING,
    (_M.TRACKING, _E.DOUBT): _M.STOPPING,
    (_M.TRACKING, _E.FAULT): _M.FAULTED,
    (_M.ADMITTANCE, _E.PAUSE): _M.ADMITTANCE,
    (_M.ADMITTANCE, _E.ABANDON): _M.ADMITTANCE,
    (_M.ADMITTANCE, _E.STOP): _M.STOPPING,
    (_M.ADMITTANCE, _E.DISARM): _M.STOPPING,
    (_M.ADMITTANCE, _E.DISABLE): _M.STOPPING,
    (_M.ADMITTANCE, _E.RETRACT): _M.RETRACTING,
    (_M.ADMITTANCE, _E.HALT): _M.STOPPING,
    (_M.ADMITTANCE, _E.RESUME): _M.TRACKING,
    (_M.ADMITTANCE, _E.RETURN): _M.RETURNING,
    (_M.ADMITTANCE, _E.SETTLE): _M.HOLDING,
    (_M.ADMITTANCE, _E.BOUND): _M.STOPPING,
    (_M.ADMITTANCE, _E.DOUBT): _M.STOPPING,
    (_M.ADMITTANCE, _E.FAULT): _M.FAULTED,
    (_M.RETRACTING, _E.PAUSE): _M.RETRACTING,
    (_M.RETRACTING, _E.ABANDON): _M.RETRACTING,
    (_M.RETRACTING, _E.STOP): _M.STOPPING,
    (_M.RETRACTING, _E.DISARM): _M.STOPPING,
    (_M.RETRACTING, _E.DISABLE): _M.STOPPING,
    (_M.RETRACTING, _E.TOUCH): _M.ADMITTANCE,
    (_M.RETRACTING, _E.RETRACT): _M.RETRACTING,
    (_M.RETRACTING, _E.RELEASE): _M.RELEASING,
    (_M.RETRACTING, _E.HALT): _M.STOPPING,
    (_M.RETRACTING, _E.RESUME): _M.TRACKING,
    (_M.RETRACTING, _E.RETURN): _M.RETURNING,
    (_M.RETRACTING, _E.SETTLE): _M.HOLDING,
    (_M.RETRACTING, _E.BOUND): _M.STOPPING,
    (_M.RETRACTING, _E.DOUBT): _M.STOPPING,
    (_M.RETRACTING, _E.FAULT): _M.FAULTED,
    (_M.RETURNING, _E.PAUSE): _M.STOPPING,
    (_M.RETURNING, _E.ABANDON): _M.STOPPING,
    (_M.RETURNING, _E.STOP): _M.STOPPING,
    (_M.RETURNING, _E.DISARM): _M.STOPPING,
    (_M.RETURNING, _E.DISABLE): _M.STOPPING,
    (_M.RETURNING, _E.TOUCH): _M.ADMITTANCE,
    (_M.RETURNING, _E.RETRACT): _M.RETRACTING,
    (_M.RETURNING, _E.RELEASE): _M.RELEASING,
    (_M.RETURNING, _E.HALT): _M.STOPPING,
    (_M.RETURNING, _E.ARRIVED): _M.TRACKING,
    (_M.RETURNING, _E.TIMEOUT): _M.STOPPING,
    (_M.RETURNING, _E.DOUBT): _M.STOPPING,
    (_M.RETURNING, _E.FAULT): _M.FAULTED,
    (_M.RELEASING, _E.PAUSE): _M.RELEASING,
    (_M.RELEASING, _E.ABANDON): _M.RELEASING,
    (_M.RELEASING, _E.STOP): _M.STOPPING,
    (_M.RELEASING, _E.DISARM): _M.RELEASING,
    (_M.RELEASING, _E.DISABLE): _M.STOPPING,
    (_M.RELEASING, _E.HALT): _M.STOPPING,
    (_M.RELEASING, _E.BOUND): _M.STOPPING,
    (_M.RELEASING, _E.DOUBT): _M.STOPPING,
    (_M.RELEASING, _E.FAULT): _M.FAULTED,
    (_M.STOPPING, _E.STANDSTILL): _M.HOLDING,
    (_M.STOPPING, _E.TOUCH): _M.ADMITTANCE,
    (_M.STOPPING, _E.RETRACT): _M.RETRACTING,
    (_M.STOPPING, _E.RELEASE): _M.RELEASING,
    (_M.STOPPING, _E.PAUSE): _M.STOPPING,
    (_M.STOPPING, _E.ABANDON): _M.STOPPING,
    (_M.STOPPING, _E.STOP): _M.STOPPING,
    (_M.STOPPING, _E.DISARM): _M.STOPPING,
    (_M.STOPPING, _E.DISABLE): _M.STOPPING,
    (_M.STOPPING, _E.DOUBT): _M.STOPPING,
    (_M.STOPPING, _E.TIMEOUT): _M.FAULTED,
    (_M.STOPPING, _E.FAULT): _M.FAULTED,
    (_M.FAULTED, _E.RESET): _M.OFF,
    (_M.FAULTED, _E.STOP): _M.FAULTED,
    (_M.FAULTED, _E.DISARM): _M.FAULTED,
}

# Modes caused by a contact; a trajectory that it interrupted continues after these.
GUIDED = frozenset({_M.ADMITTANCE, _M.RETRACTING, _M.RETURNING})
# Modes in which the arm moves the way it is pushed.
YIELDING = frozenset({_M.ADMITTANCE, _M.RETRACTING, _M.RELEASING})
# Modes in which contacts are detected: in others the motor currents do not show contact.
SENSING = frozenset({_M.HOLDING, _M.TRACKING, _M.STOPPING, _M.RELEASING, *GUIDED})
ARMABLE = frozenset({_M.HOLDING, _M.TRACKING})
ENERGISED = frozenset({_M.ENABLING, *SENSING})

# Events that revoke the permission; it takes another `arm`.
DISARMING = frozenset(
    {_E.DISARM, _E.STOP, _E.DISABLE, _E.BOUND, _E.TIMEOUT, _E.DOUBT, _E.FAULT, _E.RESET}
)

# Events that halt a trajectory, which continues with the next `start`.
HALTING = frozenset({_E.PAUSE, _E.SETTLE, _E.RELEASE, _E.HALT})
# Events after which the configured trajectory starts from its beginning.
FORGETTING = frozenset({_E.ABANDON, _E.STOP, _E.DISABLE, _E.TIMEOUT, _E.FAULT, _E.RESET})
# Events after which no trajectory continues by itself, whatever a contact causes.
WAITING = frozenset({_E.PAUSE, _E.ABANDON})

# Reason for a refusal in each mode.
REFUSALS: dict[Mode, str] = {
    _M.OFF: "the drives are off",
    _M.ENABLING: "the drives are still being enabled",
    _M.HOLDING: "the arm is holding",
    _M.TRACKING: "the trajectory is running",
    _M.ADMITTANCE: "the arm is being led",
    _M.RETRACTING: "the arm is backing away from a contact",
    _M.RETURNING: "the arm is going back to its trajectory",
    _M.RELEASING: "the arm is letting go after a collision",
    _M.STOPPING: "the arm is still stopping",
    _M.FAULTED: "a fault is latched",
}
# Command that leads from a mode to one in which the arm can be started or armed.
ADVICE: dict[Mode, str] = {
    _M.OFF: "`contactctl enable` first",
    _M.TRACKING: "`contactctl pause` or `stop` first",
    _M.ADMITTANCE: "`contactctl stop` first",
    _M.RETRACTING: "`contactctl stop` first",
    _M.RETURNING: "`contactctl stop` first",
    _M.FAULTED: "`contactctl reset` first",
}
_ADVISED = frozenset({"start", "arm"})


def refusal(mode: Mode, command: str) -> str:
    """Reason why `command` is refused in this mode, with advice if there is any."""
    if command == _E.RESET:
        return "no fault is latched"
    # `reset` helps every command; the other advice leads to holding, which only start and arm need.
    advised = mode in ADVICE and (command in _ADVISED or mode is _M.FAULTED)
    return f"{REFUSALS[mode]} ({ADVICE[mode]})" if advised else REFUSALS[mode]


def next_mode(mode: Mode, event: Event) -> Mode | None:
    """Mode after `event`, or None if the table has no such row."""
    return TRANSITIONS.get((mode, event))
