"""Table of faults: one row says all of a condition, from its response to what a person does then.

Each tick the detector names the conditions that hold; the strongest response among them wins.
docs/faults.md is written from this table by `make reference`.

HOLD where what is measured can still be trusted: the arm decelerates and holds, disarmed, and a
person whom it is pressing against is one `arm` away from guiding it off. QUICK_STOP where it cannot
be, or where the drives may no longer obey: then nothing that is computed from the measurements may
move a joint, and the drives stop and hold by themselves until a person has looked.
"""

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Final

from daemon.modes.table import Event
from drivers import events


class Response(IntEnum):
    """Response of the arm to a condition, in rising order of strength."""

    CONTINUE = 0  # noted; arming is refused in such a tick
    HOLD = 1  # decelerate and hold, disarmed
    QUICK_STOP = 2  # quick stop of all drives, latched until `reset`
    FAULT_EXIT = 3  # quick stop of all drives, and the program ends with a status that is not 0

    @property
    def event(self) -> Event | None:
        """Its event of the mode table; None where the mode stays as it is."""
        if self is Response.CONTINUE:
            return None
        return Event.DOUBT if self is Response.HOLD else Event.FAULT


class Condition(StrEnum):
    """Condition that is wrong, in the words that an operator reads."""

    SAMPLE_MISSING = "sample missing"
    STALE = "samples stale"
    DEAF = "not sensing contact"
    STARVED = "samples late with the machine"
    HEARTBEAT_LOST = "heartbeat lost"
    EMERGENCY = "emergency message"
    DRIVE_FAULT = "drive fault"
    DRIVE_DROPPED = "drive left operation"
    NOT_FOLLOWING = "drive does not follow"
    IGNORES_SETPOINT = "drive ignores its setpoint"
    NOT_SEEN_TO_STOP = "drive not seen to stop"
    UNPROVED = "drive not proved to stand"
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
    ABSENT = "the daemon was absent"
    PROGRAM_ERROR = "error in the program"


@dataclass(frozen=True, slots=True)
class Row:
    """All of one condition, in Markdown where it is text."""

    response: Response
    check: str  # name of the arming check that fails with it
    when: str  # what it is found by
    why: str  # reason for this response
    advice: str  # what a person at the arm does then
    source: type[events.BusEvent] | None = None  # event that means it, whatever else holds


_C, _R = Condition, Response

TABLE: Final[dict[Condition, Row]] = {
    # --- drives and bus -----------------------------------------------------------------------
    _C.SAMPLE_MISSING: Row(
        _R.CONTINUE,
        "samples",
        "a TPDO has not come when its tick decides",
        "one frame may be lost; its joint's interval lasts until the next one comes, and the other "
        "joints sense on",
        "nothing; if it comes often, check cable, termination, and the load by `contactd check`",
    ),
    _C.STALE: Row(
        _R.QUICK_STOP,
        "samples",
        "`stale_ticks` ticks in a row without a TPDO of some drive; or three times as many, less "
        "those with one. After a start or a reset a drive has 30 ticks for its first; until then "
        "`contactctl status` shows what was before with its age",
        "that joint is blind, its drive perhaps deaf",
        "check supply and CAN cable of the drive that is named, then `contactctl reset`",
    ),
    _C.DEAF: Row(
        _R.HOLD,
        "estimator",
        "in 5 ticks, less half of those in which all do, some joint senses nothing: its samples "
        "have been missing for more than 2.5 periods, or its residual begins anew",
        "a hand would not be felt there, so nothing may move as if it were",
        "see in `contactctl status` which joint; check the cable of its drive, and the load of bus "
        "and computer; then `contactctl arm`",
    ),
    _C.STARVED: Row(
        _R.HOLD,
        "samples",
        "samples are stale while ticks come late, too; up to three times as long",
        "the machine was late, not the drive: standing still needs no samples",
        "take load off the computer, see `real time` in `contactctl status`; then `contactctl arm`",
    ),
    _C.HEARTBEAT_LOST: Row(
        _R.QUICK_STOP,
        "heartbeats",
        "nothing of a drive for three of its heartbeats",
        "its program, its supply or its cable is gone",
        "check supply and CAN cable of the drive, then `contactctl reset`, which sets it up again",
        source=events.HeartbeatLost,
    ),
    _C.EMERGENCY: Row(
        _R.QUICK_STOP,
        "emergencies",
        "an EMCY message with an error code (over-current, under-voltage, over-temperature, ...)",
        "what a drive finds worth an emergency it may not survive",
        "look up the code in the drive's manual, remove the cause, then `contactctl reset`",
        source=events.Emergency,
    ),
    _C.DRIVE_FAULT: Row(
        _R.QUICK_STOP,
        "drives",
        "a statusword that says fault, or fault reaction",
        "one joint has stopped or lost its torque: the others must not go on",
        "look up the drive's error (the log, its maker's tool), remove it, then `contactctl reset`",
    ),
    _C.DRIVE_DROPPED: Row(
        _R.QUICK_STOP,
        "drives",
        "a drive that should run is not in operation enabled, or not operational",
        "somebody or something else switched it, an emergency stop for one",
        "release the emergency stop, or close the tool that did it, then `contactctl reset`",
        source=events.NotOperational,
    ),
    _C.NOT_FOLLOWING: Row(
        _R.QUICK_STOP,
        "drives",
        "for 20 ticks a motor's velocity differs from its setpoints by more than "
        "`following_margin` times its velocity limit, and its current does not press the right way "
        "with half of what it may, nor, for half a second after enabling, has gone that way at all",
        "the drive sends, but seems not to hear us, or to have gone its own way",
        "close other tools on the bus, then `contactctl reset`; a drive with a soft velocity loop "
        "needs a larger margin: docs/porting.md, step 8",
    ),
    _C.IGNORES_SETPOINT: Row(
        _R.QUICK_STOP,
        "drives",
        "a drive in operation clears the bit that says that it follows its command (12 of the "
        "statusword) for three ticks, with less than half of its current; only of drives that have "
        "set it",
        "somebody's tool has chosen another mode of operation, or halted it: it does what it likes",
        "close other tools on the bus, then `contactctl reset`: the log says which object was "
        "changed, and the drive is set up again",
    ),
    _C.NOT_SEEN_TO_STOP: Row(
        _R.QUICK_STOP,
        "drives",
        "a drive was told to stop, by its setpoint and by SDO, and for some ticks no fresh "
        "statusword says that it has left operation (to be without power it may take 1 s, for its "
        "brake); or it says so, and moves on as if it did not",
        "it gets an NMT stop, at which a drive stops by itself (0x6007), and is then asked by SDO; "
        "one that says that it stops, and moves on beyond its travel, loses its power",
        "keep away from the arm, and press the emergency stop if it moves; check supply and CAN "
        "cable of the drive, close other tools on the bus, then `contactctl reset`",
        source=events.NotSeenToStop,
    ),
    _C.UNPROVED: Row(
        _R.QUICK_STOP,
        "drives",
        "no proof after the NMT stop either; or a joint that was told to stop is about to go "
        "further than `contactd check` prints",
        "only silence is left: no heartbeat, no SYNC, no setpoint to any drive until `reset`, so "
        "that each stops by itself (0x1016, 0x6007)",
        "press the emergency stop if anything moves; find out why the drive cannot be heard; then "
        "`contactctl reset`, which sets all drives up again. A drive that went on moving must not "
        "move again before it was tried on the bench that it stops without its master: "
        "docs/porting.md, step 9",
        source=events.Unproved,
    ),
    _C.REBOOTED: Row(
        _R.QUICK_STOP,
        "set-up",
        "a boot-up message",
        "the drive has lost its set-up; `reset` sets it up again",
        "find out why it restarted (supply, plug, emergency stop), then `contactctl reset`",
        source=events.Rebooted,
    ),
    _C.FOREIGN_MASTER: Row(
        _R.QUICK_STOP,
        "faults",
        "SYNC, NMT, a setpoint or the master's heartbeat from somebody else",
        "two masters: nobody knows whose setpoints the drives follow",
        "close the other master (a maker's tool, a second daemon), then `contactctl reset`",
        source=events.ForeignMaster,
    ),
    _C.BUS_DISTURBED: Row(
        _R.CONTINUE,
        "faults",
        "sending or receiving fails (ENOBUFS), an error frame, an answer a period late",
        "it may be over with the next frame",
        "nothing; if it comes often, check cable, termination, and the load by `contactd check`",
    ),
    _C.BUS_TROUBLE: Row(
        _R.QUICK_STOP,
        "faults",
        "the bus is disturbed in `stale_ticks` ticks in a row",
        "setpoints may no longer arrive; the quick stop goes out with the first frame that passes",
        "see that the interface is up (`ip link`), the drives have power, the cable is whole and "
        "terminated; then `contactctl reset`",
    ),
    _C.ERROR_PASSIVE: Row(
        _R.HOLD,
        "faults",
        "an error frame says that the CAN controller is error-passive",
        "samples and setpoints still pass: stand still as long as they do",
        "check cable, termination (120 ohm at both ends) and bitrate, then `contactctl arm`",
        source=events.ErrorPassive,
    ),
    _C.BUS_OFF: Row(
        _R.QUICK_STOP,
        "faults",
        "an error frame says that the CAN controller has left the bus",
        "nothing gets out any more; the drives miss the heartbeat and stop by themselves",
        "look for a short circuit, missing termination, a wrong bitrate; see that the interface is "
        "up again (`ip link`); then `contactctl reset`",
        source=events.BusOff,
    ),
    _C.ADAPTER_GONE: Row(
        _R.FAULT_EXIT,
        "faults",
        "the socket says that its device or its peer is gone",
        "this bus does not come back: it must be opened, and the drives set up, anew",
        "plug the adapter in again, or start the gateway; start contactd if systemd does not",
        source=events.AdapterGone,
    ),
    # --- what is measured ---------------------------------------------------------------------
    _C.NOT_FINITE: Row(
        _R.QUICK_STOP,
        "faults",
        "NaN or infinity in samples, estimate, reference or setpoint",
        "whatever is computed from it is arbitrary",
        "`contactctl reset`; if it comes back, report it, with a recording and the black box",
        source=events.BadSetpoint,
    ),
    _C.JUMP: Row(
        _R.QUICK_STOP,
        "faults",
        "a link moved further in a tick, against its motor, than at `speed_margin` times its "
        "velocity limit, the gap and `position_margin` together",
        "before or after, the position is false: limits and path mean nothing",
        "check cable and seat of the link encoder, and its position in `contactctl watch`, then "
        "`contactctl reset`",
    ),
    _C.FROZEN: Row(
        _R.QUICK_STOP,
        "faults",
        "a link encoder repeats one value while the motor turns by more than the gap and half of "
        "`position_margin`",
        "the joint would be moved blindly, and a hand not be felt",
        "check cable and seat of the link encoder; see in `contactctl watch` that its position "
        "follows the link, then `contactctl reset`",
    ),
    _C.APART: Row(
        _R.QUICK_STOP,
        "faults",
        "motor and link have moved against each other by more than the gap and `position_margin`",
        "a slipping gear or a false encoder: the residual is arbitrary",
        "check gear, coupling and encoders, of a new arm whether its link goes the other way than "
        "its motor (`link_sign`, `motor_sign`), then `contactctl reset`; if they are sound, the "
        "gap is wider than `half_gap`: `contactd identify gap`",
    ),
    _C.TORQUE_STUCK: Row(
        _R.QUICK_STOP,
        "faults",
        "the current repeats one value for 20 ticks, while the motor turns by 0.1 rad",
        "the arm feels nothing, so it must not move",
        "switch the drive off and on, then `contactctl reset`; of a new drive, look whether that "
        "object is measured: docs/porting.md, step 2",
    ),
    _C.TORQUE_SATURATED: Row(
        _R.HOLD,
        "faults",
        "the current stays at its limit (95 %) for `saturated_ticks` ticks, unless guided",
        "the joint pushes as hard as it can, perhaps against somebody: stop pushing on; the arm "
        "still feels, and may be armed and led away",
        "free whom or what it presses against: `contactctl arm`, and lead it away; if it was "
        "nothing, the joint carries more than `max_current_A` allows",
    ),
    _C.RESIDUAL_LIMIT: Row(
        _R.QUICK_STOP,
        "residual",
        "a residual beyond `residual_margin` times the joint's collision level",
        "a crash, or an estimate that has nothing to do with the arm",
        "see to people and arm, then `contactctl reset`; if nothing was hit, masses, payload or "
        "friction are not the arm's: docs/commissioning.md",
    ),
    _C.OVERSPEED: Row(
        _R.QUICK_STOP,
        "faults",
        "a motor is faster than `speed_margin` times its velocity limit for three ticks, and does "
        "not brake with half its current",
        "the drive does not follow its setpoints: only another command can stop it",
        "if nobody pushed, check sign and scale of velocities (`contactd identify wiring`) and the "
        "drive's velocity loop; then `contactctl reset`",
    ),
    _C.JOINT_LIMIT: Row(
        _R.HOLD,
        "limits",
        "a joint beyond its limit by `position_margin` and going on outwards",
        "setpoints never lead there: somebody pushes. A latch would keep it there, as enabling is "
        "refused so far outside the limits; holding leads it back",
        "let go of the arm: it goes back by itself; then `contactctl arm`",
    ),
    # --- time ---------------------------------------------------------------------------------
    _C.LATE: Row(
        _R.CONTINUE,
        "loop",
        "a tick begins so late that the next deadline has to be left out",
        "one is left out, and the true interval used",
        "nothing; if it comes often, take load off the computer",
    ),
    _C.OVERRUN: Row(
        _R.HOLD,
        "loop",
        "`overrun_ticks` deadlines missed, less half of the ticks on time",
        "setpoints grow old on a machine that is too busy, but they still come",
        "take load off the computer, see `real time` in `contactctl status`; then `contactctl arm`",
    ),
    _C.ABSENT: Row(
        _R.QUICK_STOP,
        "loop",
        "for nearly as long as the drives wait for it (`master_timeout_ms`), no heartbeat of ours "
        "went out: the loop was held up, or the bus took no frame",
        "they may have stopped by themselves, and would run on at the next SYNC: each is told to "
        "stop first, by SDO, and has to confirm it",
        "find what held the daemon up (a debugger, a suspended computer) or took its bus away, "
        "then `contactctl reset`",
        source=events.Absent,
    ),
    _C.PROGRAM_ERROR: Row(
        _R.FAULT_EXIT,
        "faults",
        "an exception anywhere in the loop; its traceback is in the log",
        "what has gone wrong is unknown, so nothing that the program holds can be relied on",
        "report it, with the traceback and the black box; start contactd if systemd does not",
    ),
}
