"""Table of faults: one row for each condition, from its detection and response to the advice.

Each tick the detector names the conditions that hold; the strongest response among them wins.
docs/faults.md is written from this table by `make reference`.

HOLD is the response while the measurements can still be trusted: the arm decelerates and holds,
disarmed, and a person against whom it presses can guide it away after one `arm`. QUICK_STOP is the
response when they cannot, or when the drives may no longer follow: then nothing that is computed
from the measurements may move a joint, and the drives stop and hold by themselves until a person
has checked the arm.
"""

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Final

from daemon.modes.table import Event
from drivers.api import Kind


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
    """Condition that is wrong, as shown to an operator."""

    SAMPLE_MISSING = "sample missing"
    STALE = "samples stale"
    DEAF = "not sensing contact"
    STARVED = "samples late with the machine"
    OLD = "samples a period old"
    HEARTBEAT_LOST = "heartbeat lost"
    UNHEARD = "the daemon was not heard by a drive"
    EMERGENCY = "emergency message"
    DRIVE_FAULT = "drive fault"
    DRIVE_DROPPED = "drive left operation"
    SUPPLY_LOST = "drive without supply"
    NOT_FOLLOWING = "drive does not follow"
    IGNORES_SETPOINT = "drive ignores its setpoint"
    NOT_SEEN_TO_STOP = "drive not seen to stop"
    UNPROVED = "drive not proved to stand"
    REBOOTED = "drive restarted"
    FOREIGN_MASTER = "another master on the bus"
    TWO_DRIVES = "two drives with one node number"
    BUS_LOADED = "bus loaded"
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
    """Row of one condition; texts are Markdown."""

    response: Response
    check: str  # name of the arming check that fails with it
    when: str  # how it is detected
    why: str  # reason for this response
    advice: str  # advice for a person at the arm
    source: Kind | None = None  # event that always means this condition


_C, _R = Condition, Response

TABLE: Final[dict[Condition, Row]] = {
    # --- drives and bus -----------------------------------------------------------------------
    _C.SAMPLE_MISSING: Row(
        _R.CONTINUE,
        "samples",
        "a TPDO has not arrived when its tick decides",
        "one frame may be lost; its joint's interval extends to the next one, and the other "
        "joints sense",
        "nothing; if it is frequent, check cable, termination, and the bus load with `contactd "
        "check`",
    ),
    _C.STALE: Row(
        _R.QUICK_STOP,
        "samples",
        "no TPDO of a drive for `stale_ticks` ticks in a row, or in three times as many, less "
        "those with one. After a start or a reset a drive has 30 ticks for its first; until then "
        "`contactctl status` shows the old values with their age",
        "the joint's state is unknown, and its drive may be deaf",
        "check supply and CAN cable of the named drive, then `contactctl reset`",
    ),
    _C.DEAF: Row(
        _R.HOLD,
        "estimator",
        "a joint does not sense for 5 ticks; each tick in which all sense takes half a tick off "
        "that. It has had no samples for more than 2.5 periods, or its residual restarts",
        "contacts there would not be detected",
        "`contactctl status` names the joint: check the cable of its drive, and the load of bus "
        "and computer; then `contactctl arm`",
    ),
    _C.STARVED: Row(
        _R.HOLD,
        "samples",
        "samples are stale while ticks are late, too; up to three times as long",
        "the machine was late, not the drive; standing still needs no samples",
        "reduce the load of the computer (`real time` in `contactctl status`), then `contactctl "
        "arm`",
    ),
    _C.OLD: Row(
        _R.HOLD,
        "samples",
        "a drive answers in a tick in which no SYNC is sent. One is skipped after a drive missed "
        "one, every ten seconds at most: either that answer was lost, or all since belong to the "
        "SYNC before",
        "contacts would be detected a period later than assumed; standing still does not need the "
        "samples of this tick",
        "make the drive, or the adapter, answer within 0.6 of the period: a shorter queue or "
        "latency (slcan, socketcand over a network), fewer TPDOs, a longer `period_ms`; then "
        "`contactctl arm`",
        source=Kind.OLD_SAMPLES,
    ),
    _C.HEARTBEAT_LOST: Row(
        _R.QUICK_STOP,
        "heartbeats",
        "nothing received from a drive for three of its heartbeats",
        "its program, supply or cable has failed",
        "check supply and CAN cable of the drive, then `contactctl reset`, which sets it up again",
        source=Kind.SILENT,
    ),
    _C.UNHEARD: Row(
        _R.QUICK_STOP,
        "heartbeats",
        "an EMCY message with code 0x8130: a drive missed contactd's heartbeat "
        "(`master_timeout_ms`). On a loaded bus the load and its source are shown",
        "that drive has stopped by itself; others will",
        "if a bus load is shown, find who sends those frames, and switch it off; else check CAN "
        "cable and termination of the named drive, and `real time` in `contactctl status`; then "
        "`contactctl reset`",
        source=Kind.UNHEARD,
    ),
    _C.EMERGENCY: Row(
        _R.QUICK_STOP,
        "emergencies",
        "an EMCY message with an error code (over-current, under-voltage, over-temperature, ...). "
        "Protocol errors (0x82xx) do not count for half a second after the set-up of the drive "
        "was read back, as they concern earlier frames",
        "the drive may be about to fail",
        "look up the code in the drive's manual, remove the cause, then `contactctl reset`",
        source=Kind.ERROR,
    ),
    _C.DRIVE_FAULT: Row(
        _R.QUICK_STOP,
        "drives",
        "a statusword reports fault or fault reaction",
        "one joint has stopped or lost its torque; the others must not continue",
        "look up the drive's error (the log, its maker's tool), remove its cause, then "
        "`contactctl reset`",
    ),
    _C.DRIVE_DROPPED: Row(
        _R.QUICK_STOP,
        "drives",
        "a drive that should run is not in operation enabled, or not operational",
        "something else switched it, such as an emergency stop",
        "release the emergency stop, or close the tool that switched it, then `contactctl reset`",
        source=Kind.DROPPED,
    ),
    _C.SUPPLY_LOST: Row(
        _R.QUICK_STOP,
        "drives",
        "a drive that should run clears bit 4 of its statusword (voltage enabled), for two "
        "samples if it reports operation enabled; only for drives that have set it before",
        "its motor has no torque: the joint falls, or stands in its brake; the others must not "
        "continue",
        "check the emergency stop, then supply, fuse and contactor of the named drive; a supply "
        "that breaks down while the arm accelerates is too weak; then `contactctl reset`",
    ),
    _C.NOT_FOLLOWING: Row(
        _R.QUICK_STOP,
        "drives",
        "for 20 ticks a motor's velocity differs from its setpoints by more than "
        "`following_margin` times its velocity limit, and its current does not press the right "
        "way with half of what it may (for half a second after enabling: has not moved that way "
        "at all)",
        "the drive sends, but does not receive setpoints, or does not obey them",
        "close other tools on the bus, then `contactctl reset`; a drive with a soft velocity loop "
        "needs a larger margin: docs/porting.md, step 8",
    ),
    _C.IGNORES_SETPOINT: Row(
        _R.QUICK_STOP,
        "drives",
        "a drive in operation clears bit 12 of its statusword (follows the command) for three "
        "ticks, with less than half of its current; only for drives that have set it",
        "another tool has chosen another mode of operation, or halted it",
        "close other tools on the bus, then `contactctl reset`: the log names the changed object, "
        "and the drive is set up again",
    ),
    _C.NOT_SEEN_TO_STOP: Row(
        _R.QUICK_STOP,
        "drives",
        "a drive was commanded to stop, by its setpoint and by SDO, and for some ticks no fresh "
        "statusword shows that it left operation; or one shows it, and the drive moves on",
        "it gets an NMT stop, at which a drive stops by itself (0x6007), and is asked by SDO; one "
        "that reports a stop, but moves beyond its travel, loses its power",
        "keep away from the arm, and press the emergency stop if it moves; check supply and CAN "
        "cable of the drive, close other tools on the bus, then `contactctl reset`",
        source=Kind.NOT_SEEN_TO_STOP,
    ),
    _C.UNPROVED: Row(
        _R.QUICK_STOP,
        "drives",
        "no proof after the NMT stop either; or a joint commanded to stop is about to go further "
        "than `contactd check` prints",
        "only silence is left: no heartbeat, SYNC or setpoint to any drive until `reset`, so that "
        "each stops by itself (0x1016, 0x6007)",
        "press the emergency stop if anything moves; find out why the drive cannot be heard; then "
        "`contactctl reset`, which sets up all drives again. Before a drive that went on moving "
        "moves an arm again, test on the bench that it stops without its master: docs/porting.md, "
        "step 9",
        source=Kind.UNPROVED,
    ),
    _C.REBOOTED: Row(
        _R.QUICK_STOP,
        "set-up",
        "a boot-up message",
        "the drive lost its set-up; `reset` sets it up again",
        "find out why it restarted (supply, plug, emergency stop), then `contactctl reset`",
        source=Kind.RESTARTED,
    ),
    _C.FOREIGN_MASTER: Row(
        _R.QUICK_STOP,
        "faults",
        "SYNC, NMT, a setpoint or the master's heartbeat from another sender",
        "with two masters it is unknown whose setpoints the drives follow",
        "close the other master (a maker's tool, a second daemon), then `contactctl reset`",
        source=Kind.FOREIGN_MASTER,
    ),
    _C.TWO_DRIVES: Row(
        _R.QUICK_STOP,
        "faults",
        "a drive answers five SYNCs in a row twice; at the start, in a reset and in `contactd "
        "scan`, its SDO requests",
        "their measurements cannot be distinguished, and both take the same setpoints",
        "switch one drive off, give it a node number of its own with its maker's tool, check with "
        "`contactd scan` that each answers once; then `contactctl reset`",
        source=Kind.TWO_DRIVES,
    ),
    _C.BUS_LOADED: Row(
        _R.CONTINUE,
        "faults",
        "frames of others and the arm's own PDOs take more than 80 % of the bus, averaged over 50 "
        "ms, without stuff bits; their number and most frequent identifier are shown",
        "nothing is wrong while samples and heartbeats arrive; the arm stops when they do not",
        "find who sends those frames (`candump can0`), and switch it off or make it send less",
        source=Kind.LOADED,
    ),
    _C.BUS_DISTURBED: Row(
        _R.CONTINUE,
        "faults",
        "sending or receiving fails (ENOBUFS), an error frame, an answer a period late",
        "it may be over with the next frame",
        "nothing; if it is frequent, check cable, termination, and the bus load with `contactd "
        "check`",
    ),
    _C.BUS_TROUBLE: Row(
        _R.QUICK_STOP,
        "faults",
        "the bus is disturbed in `stale_ticks` ticks in a row",
        "setpoints may not arrive; the quick stop goes out with the first frame that passes",
        "check that the interface is up (`ip link`), the drives have power, and the cable is "
        "whole and terminated; then `contactctl reset`",
    ),
    _C.ERROR_PASSIVE: Row(
        _R.HOLD,
        "faults",
        "an error frame reports that the CAN controller is error-passive",
        "samples and setpoints still pass",
        "check cable, termination (120 ohm at both ends) and bitrate, then `contactctl arm`",
        source=Kind.PASSIVE,
    ),
    _C.BUS_OFF: Row(
        _R.QUICK_STOP,
        "faults",
        "an error frame reports that the CAN controller has left the bus",
        "nothing is sent any more; the drives miss the heartbeat and stop by themselves",
        "look for a short circuit, missing termination or a wrong bitrate; check that the "
        "interface is up again (`ip link`); then `contactctl reset`",
        source=Kind.OFF_BUS,
    ),
    _C.ADAPTER_GONE: Row(
        _R.FAULT_EXIT,
        "faults",
        "the socket reports that its device or its peer is gone",
        "the bus must be opened, and the drives set up, again",
        "plug the adapter in again, or start the gateway; start contactd if systemd does not",
        source=Kind.ADAPTER_GONE,
    ),
    # --- what is measured ---------------------------------------------------------------------
    _C.NOT_FINITE: Row(
        _R.QUICK_STOP,
        "faults",
        "NaN or infinity in samples, estimate, reference or setpoint",
        "all results from it are arbitrary",
        "`contactctl reset`; if it recurs, report it with a recording and the black box",
        source=Kind.BAD_SETPOINT,
    ),
    _C.JUMP: Row(
        _R.QUICK_STOP,
        "faults",
        "a link moved further in a tick, against its motor, than `speed_margin` times its "
        "velocity limit, the gap and `position_margin` allow together",
        "the position is wrong before or after it, and with it limits and path",
        "check cable and seat of the link encoder, and its position in `contactctl watch`, then "
        "`contactctl reset`",
    ),
    _C.FROZEN: Row(
        _R.QUICK_STOP,
        "faults",
        "a link encoder repeats one value while the motor turns by more than the gap and half of "
        "`position_margin`; or all measurements of a drive repeat to the last bit in 10 samples, "
        "while its velocity or its setpoint shows motion",
        "the joint would move blindly, and contacts would not be detected",
        "check cable and seat of the link encoder, and in `contactctl watch` that its position "
        "follows the link, then `contactctl reset`",
        source=Kind.REPEATED_SAMPLES,
    ),
    _C.APART: Row(
        _R.QUICK_STOP,
        "faults",
        "motor and link have moved against each other by more than the gap and `position_margin`",
        "a gear slips or an encoder is wrong: the residual is arbitrary",
        "check gear, coupling and encoders, on a new arm whether the link turns against its motor "
        "(`link_sign`, `motor_sign`), then `contactctl reset`; if they are sound, the gap is "
        "wider than `half_gap`: `contactd identify gap`",
    ),
    _C.TORQUE_STUCK: Row(
        _R.QUICK_STOP,
        "faults",
        "the current repeats one value for 20 ticks, while the motor turns by 0.1 rad",
        "contacts are not detected, so the arm must not move",
        "switch the drive off and on, then `contactctl reset`; on a new drive, check that this "
        "object is measured: docs/porting.md, step 2",
    ),
    _C.TORQUE_SATURATED: Row(
        _R.HOLD,
        "faults",
        "the current stays at its limit (95 %) for `saturated_ticks` ticks, unless guided",
        "the joint pushes as hard as it can, perhaps against a person; the arm still senses, and "
        "can be armed and led away",
        "free the person or object that it presses against: `contactctl arm`, and lead it away; "
        "if there is none, the joint carries more than `max_current_A` allows",
    ),
    _C.RESIDUAL_LIMIT: Row(
        _R.QUICK_STOP,
        "residual",
        "a residual beyond `residual_margin` times the joint's collision level",
        "a crash, or an estimate that does not describe the arm",
        "check people and arm, then `contactctl reset`; if nothing was hit, masses, payload or "
        "friction are wrong: docs/commissioning.md",
    ),
    _C.OVERSPEED: Row(
        _R.QUICK_STOP,
        "faults",
        "a motor is faster than `speed_margin` times its velocity limit for three ticks, and does "
        "not brake with half its current",
        "the drive does not follow its setpoints; only another command can stop it",
        "if it was not pushed, check sign and scale of velocities (`contactd identify wiring`) "
        "and the drive's velocity loop; then `contactctl reset`",
    ),
    _C.JOINT_LIMIT: Row(
        _R.HOLD,
        "limits",
        "a joint is beyond its limit by `position_margin` and moves on outwards",
        "setpoints never lead there: it is pushed. A latched fault would keep it there, as "
        "enabling is refused so far outside; holding leads it back",
        "let go of the arm: it returns by itself; then `contactctl arm`",
    ),
    # --- time ---------------------------------------------------------------------------------
    _C.LATE: Row(
        _R.CONTINUE,
        "loop",
        "a tick begins so late that the next deadline must be skipped",
        "one deadline is skipped, and the true interval used",
        "nothing; if it is frequent, reduce the load of the computer",
    ),
    _C.OVERRUN: Row(
        _R.HOLD,
        "loop",
        "`overrun_ticks` deadlines missed, less half of the ticks on time",
        "the machine is too busy: setpoints are old, but still arrive",
        "reduce the load of the computer (`real time` in `contactctl status`), then `contactctl "
        "arm`",
    ),
    _C.ABSENT: Row(
        _R.QUICK_STOP,
        "loop",
        "no heartbeat of contactd for nearly as long as the drives wait for it "
        "(`master_timeout_ms`): the loop was held up, or the bus took no frame",
        "the drives may have stopped by themselves, and would run on at the next SYNC: each is "
        "first stopped by SDO, and has to confirm it",
        "find what held the daemon up (a debugger, a suspended computer) or blocked its bus, then "
        "`contactctl reset`",
        source=Kind.ABSENT,
    ),
    _C.PROGRAM_ERROR: Row(
        _R.FAULT_EXIT,
        "faults",
        "an exception anywhere in the loop; its traceback is in the log",
        "no data of the program can be relied on",
        "report it with the traceback and the black box; start contactd if systemd does not",
    ),
}
