"""When doubt becomes a reaction: one pure table of conditions.

Each tick the observer names the conditions that hold; the strongest reaction among them wins.
docs/faults.md shows this table to the people beside the arm.

HOLD where what is measured can still be trusted: the arm decelerates and holds, disarmed, and a
person whom it is pressing against is one `arm` away from guiding it off. QUICK_STOP where it cannot
be, or where the drives may no longer do as they are told: then nothing that is computed from the
measurements may move a joint, and the drives stop and hold by themselves until a person has looked.
"""

from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import Final

from daemon.modes.table import Event


class Response(IntEnum):
    """In rising order of strength."""

    CONTINUE = 0  # noted; arming waits until it is over
    HOLD = 1  # decelerate and hold, disarmed
    QUICK_STOP = 2  # quick stop of all drives, latched until `reset`
    FAULT_EXIT = 3  # quick stop of all drives, and the program ends with a status that is not 0


class Condition(StrEnum):
    """What may be wrong."""

    SAMPLE_MISSING = "sample missing"
    STALE = "samples stale"
    STARVED = "samples late with the machine"
    HEARTBEAT_LOST = "heartbeat lost"
    EMERGENCY = "emergency message"
    DRIVE_FAULT = "drive fault"
    DRIVE_DROPPED = "drive left operation"
    NOT_FOLLOWING = "drive does not follow"
    DISOBEDIENT = "drive does not stop"
    UNSTOPPABLE = "drive cannot be stopped"
    REBOOTED = "drive restarted"
    FOREIGN_MASTER = "another master on the bus"
    BUS_DISTURBED = "bus disturbed"
    BUS_TROUBLE = "bus trouble"
    ERROR_PASSIVE = "bus error-passive"
    BUS_OFF = "bus off"
    ADAPTER_GONE = "adapter gone"
    NOT_FINITE = "not a finite number"
    JUMP = "encoder jump"
    FROZEN = "encoder frozen"
    APART = "motor and link apart"
    TORQUE_STUCK = "torque stuck"
    TORQUE_SATURATED = "torque saturated"
    RESIDUAL_LIMIT = "residual implausible"
    OVERSPEED = "too fast"
    JOINT_LIMIT = "beyond a joint limit"
    LATE = "late tick"
    OVERRUN = "too many late ticks"
    SUSPENDED = "the daemon stood still"
    PROGRAM_ERROR = "error in the program"


@dataclass(frozen=True, slots=True)
class Row:
    """The reaction to a condition, when the condition is found, and why that reaction."""

    response: Response
    when: str
    why: str


_C, _R = Condition, Response

TABLE: Final[dict[Condition, Row]] = {
    # --- drives and bus -----------------------------------------------------------------------
    _C.SAMPLE_MISSING: Row(
        _R.CONTINUE,
        "a TPDO has not come when its tick decides",
        "one frame may be lost; the estimator waits, and uses the true interval",
    ),
    _C.STALE: Row(
        _R.QUICK_STOP,
        "`stale_ticks` ticks in a row without a TPDO of some drive; or drives that fail in turn: "
        "three times as many ticks without all of them, less those with all",
        "that joint is blind, and its drive may be deaf; nothing is estimated from a part of the "
        "drives",
    ),
    _C.STARVED: Row(
        _R.HOLD,
        "the same, while ticks came late, too; up to three times as long",
        "the machine was late, not the drive: standing still needs no samples",
    ),
    _C.HEARTBEAT_LOST: Row(
        _R.QUICK_STOP,
        "nothing of a drive for three of its heartbeats",
        "its program, its supply or its cable is gone",
    ),
    _C.EMERGENCY: Row(
        _R.QUICK_STOP,
        "an EMCY message with an error code (over-current, under-voltage, over-temperature, ...)",
        "what a drive finds worth an emergency it may not survive",
    ),
    _C.DRIVE_FAULT: Row(
        _R.QUICK_STOP,
        "a statusword that says fault, or fault reaction",
        "one joint has stopped or lost its torque: the others must not go on",
    ),
    _C.DRIVE_DROPPED: Row(
        _R.QUICK_STOP,
        "a drive that should run is not in operation enabled, or not operational",
        "somebody or something else switched it, an emergency stop for one",
    ),
    _C.NOT_FOLLOWING: Row(
        _R.QUICK_STOP,
        "for 20 ticks a motor's velocity differs from its setpoints by more than "
        "`following_margin` times its velocity limit, and its current does not press the right way "
        "with half of what it may",
        "the drive sends, but seems not to hear us, or to have gone its own way",
    ),
    _C.DISOBEDIENT: Row(
        _R.QUICK_STOP,
        "a drive is still in operation 5 ticks and 50 ms after a quick stop, 1 s after it was "
        "switched off",
        "it hears no setpoints: it gets an NMT stop, at which it stops by itself (0x6007)",
    ),
    _C.UNSTOPPABLE: Row(
        _R.FAULT_EXIT,
        "the same again after the NMT stop",
        "only silence is left: missing our heartbeat, it stops by itself",
    ),
    _C.REBOOTED: Row(
        _R.QUICK_STOP,
        "a boot-up message",
        "the drive has lost its set-up; `reset` sets it up again",
    ),
    _C.FOREIGN_MASTER: Row(
        _R.QUICK_STOP,
        "SYNC, NMT, a setpoint or the master's heartbeat from somebody else",
        "two masters: nobody knows whose setpoints the drives follow",
    ),
    _C.BUS_DISTURBED: Row(
        _R.CONTINUE,
        "sending or receiving fails (ENOBUFS), an error frame, an answer a period late",
        "it may be over with the next frame",
    ),
    _C.BUS_TROUBLE: Row(
        _R.QUICK_STOP,
        "the same in `stale_ticks` ticks in a row",
        "setpoints may no longer arrive; the quick stop goes out with the first frame that passes",
    ),
    _C.ERROR_PASSIVE: Row(
        _R.HOLD,
        "an error frame that says so",
        "samples and setpoints still pass: stand still as long as they do",
    ),
    _C.BUS_OFF: Row(
        _R.QUICK_STOP,
        "an error frame that says so",
        "nothing gets out any more; the drives miss the heartbeat and stop by themselves",
    ),
    _C.ADAPTER_GONE: Row(
        _R.FAULT_EXIT,
        "the socket says that its device or its peer is gone",
        "this bus does not come back: it must be opened, and the drives set up, anew",
    ),
    # --- what is measured ---------------------------------------------------------------------
    _C.NOT_FINITE: Row(
        _R.QUICK_STOP,
        "NaN or infinity in samples, estimate, reference or setpoint",
        "whatever is computed from it is arbitrary",
    ),
    _C.JUMP: Row(
        _R.QUICK_STOP,
        "a link moved further in a tick, against its motor, than at `speed_margin` times its "
        "velocity limit, the gap and `position_margin` together",
        "before or after, the position is false: limits and path mean nothing",
    ),
    _C.FROZEN: Row(
        _R.QUICK_STOP,
        "a link encoder repeats one value while the motor turns by more than the gap and half of "
        "`position_margin`",
        "the joint would be moved blindly, and a hand not be felt",
    ),
    _C.APART: Row(
        _R.QUICK_STOP,
        "motor and link have moved against each other by more than the gap and `position_margin`",
        "a slipping gear or a false encoder: the residual is arbitrary",
    ),
    _C.TORQUE_STUCK: Row(
        _R.QUICK_STOP,
        "the current repeats one value for 20 ticks, while the motor turns by 0.1 rad",
        "the arm feels nothing, so it must not move",
    ),
    _C.TORQUE_SATURATED: Row(
        _R.HOLD,
        "the current stays at its limit (95 %) for `saturated_ticks` ticks, unless guided",
        "the joint pushes as hard as it can, perhaps against somebody: stop pushing on; the arm "
        "still feels, and may be armed and led away",
    ),
    _C.RESIDUAL_LIMIT: Row(
        _R.QUICK_STOP,
        "a residual beyond `residual_margin` times the joint's collision level",
        "a crash, or an estimate that has nothing to do with the arm",
    ),
    _C.OVERSPEED: Row(
        _R.QUICK_STOP,
        "a motor is faster than `speed_margin` times its velocity limit for three ticks, and does "
        "not brake with half its current",
        "the drive does not follow its setpoints: only another command can stop it",
    ),
    _C.JOINT_LIMIT: Row(
        _R.HOLD,
        "a joint beyond its limit by `position_margin` and going on outwards",
        "setpoints never lead there: somebody pushes. A latch would keep it there, as enabling is "
        "refused so far outside the limits; holding leads it back",
    ),
    # --- time ---------------------------------------------------------------------------------
    _C.LATE: Row(
        _R.CONTINUE,
        "a tick begins so late that the next deadline has to be left out",
        "one is left out, and the true interval used",
    ),
    _C.OVERRUN: Row(
        _R.HOLD,
        "`overrun_ticks` deadlines missed in a row",
        "setpoints grow old on a machine that is too busy, but they still come",
    ),
    _C.SUSPENDED: Row(
        _R.QUICK_STOP,
        "a tick begins later than the drives wait for a heartbeat (`master_timeout_ms`)",
        "they have stopped by themselves, and the world has changed meanwhile",
    ),
    _C.PROGRAM_ERROR: Row(
        _R.FAULT_EXIT,
        "an exception anywhere in the loop; its traceback is in the log",
        "what has gone wrong is unknown, so nothing that the program holds can be relied on",
    ),
}

EVENT_OF: Final[dict[Response, Event | None]] = {
    Response.CONTINUE: None,
    Response.HOLD: Event.DOUBT,
    Response.QUICK_STOP: Event.FAULT,
    Response.FAULT_EXIT: Event.FAULT,
}


@dataclass(frozen=True, slots=True)
class Finding:
    """A condition that holds, and where: "LElbowRoll". Figures may change while it stays the same
    finding."""

    condition: Condition
    text: str = ""
    figures: str = field(default="", compare=False)

    @property
    def response(self) -> Response:
        """What the table asks for."""
        return TABLE[self.condition].response

    def __str__(self) -> str:
        words = f"{self.condition.value}: {self.text}" if self.text else self.condition.value
        return f"{words} ({self.figures})" if self.figures else words


def strongest(findings: tuple[Finding, ...]) -> Finding | None:
    """The finding whose reaction wins; the first among equals."""
    return max(findings, key=lambda finding: finding.response, default=None)
