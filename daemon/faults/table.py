"""Table of faults: one row for each condition, from its detection and response to the advice.

Each tick the detector names the conditions that hold; the strongest response among them wins.
docs/faults.md is written from this table by `make reference`.
"""

from typing import Final

from daemon.faults.conditions import Condition, Response, Row
from daemon.faults.drives_and_bus import DRIVES_AND_BUS
from drivers.api import Kind

_C, _R = Condition, Response

TABLE: Final[dict[Condition, Row]] = DRIVES_AND_BUS | {
    # --- measurements -------------------------------------------------------------------------
    _C.NOT_FINITE: Row(
        _R.QUICK_STOP, "faults",
        "NaN or infinity in samples, estimate, reference or setpoint",
        "all results from it are invalid",
        "`contactctl reset`; if it recurs, report it with a recording and the black box",
        source=Kind.BAD_SETPOINT,
    ),
    _C.JUMP: Row(
        _R.QUICK_STOP, "faults",
        "a link moved further in a tick, against its motor, than `speed_margin` times its "
        "velocity limit, the gap and `position_margin` allow together",
        "the position is wrong before or after it, and with it limits and path",
        "check cable and seat of the link encoder, and its position in `contactctl watch`, then "
        "`contactctl reset`",
    ),
    _C.FROZEN: Row(
        _R.QUICK_STOP, "faults",
        "a link encoder repeats one value while the motor turns by more than the gap and half of "
        "`position_margin`; or all measurements of a drive repeat to the last bit in 10 samples, "
        "while its velocity or its setpoint shows motion",
        "the joint would move blindly, and contacts would not be detected",
        "check cable and seat of the link encoder, and in `contactctl watch` that its position "
        "follows the link, then `contactctl reset`",
        source=Kind.REPEATED_SAMPLES,
    ),
    _C.APART: Row(
        _R.QUICK_STOP, "faults",
        "motor and link have moved against each other by more than the gap and `position_margin`",
        "a gear slips or an encoder is wrong: the residual is invalid",
        "check gear, coupling and encoders, on a new arm whether the link turns against its motor "
        "(`link_sign`, `motor_sign`), then `contactctl reset`; if they are sound, the gap is "
        "wider than `half_gap`: `contactd identify gap`",
    ),
    _C.TORQUE_STUCK: Row(
        _R.QUICK_STOP, "faults",
        "the current repeats one value for 20 ticks, while the motor turns by 0.1 rad",
        "contacts are not detected, so the arm must not move",
        "switch the drive off and on, then `contactctl reset`; on a new drive, check that this "
        "object is measured: docs/porting.md, step 2",
    ),
    _C.TORQUE_SATURATED: Row(
        _R.HOLD, "faults",
        "the current stays at its limit (95 %) for `saturated_ticks` ticks, unless led",
        "the joint pushes as hard as it can, perhaps against a person; the arm still senses, and "
        "can be armed and led away",
        "free the person or object that it presses against: `contactctl arm`, and lead it away; "
        "if there is none, the joint carries more than `max_current_A` allows",
    ),
    _C.RESIDUAL_LIMIT: Row(
        _R.QUICK_STOP, "residual",
        "a residual beyond `residual_margin` times the joint's collision level",
        "a crash, or an estimate that does not describe the arm",
        "check people and arm, then `contactctl reset`; if nothing was hit, masses, payload or "
        "friction are wrong: docs/commissioning.md",
    ),
    _C.OVERSPEED: Row(
        _R.QUICK_STOP, "faults",
        "a motor is faster than `speed_margin` times its velocity limit for three ticks, and does "
        "not brake with half its current",
        "the drive does not follow its setpoints; only another command can stop it",
        "if it was not pushed, check sign and scale of velocities (`contactd identify wiring`) "
        "and the drive's velocity loop; then `contactctl reset`",
    ),
    _C.JOINT_LIMIT: Row(
        _R.HOLD, "limits",
        "a joint is beyond its limit by `position_margin` and moves on outwards",
        "setpoints never lead there: it is pushed. A latched fault would keep it there, as "
        "enabling is refused so far outside; holding leads it back",
        "let go of the arm: it returns by itself; then `contactctl arm`",
    ),
    # --- time ---------------------------------------------------------------------------------
    _C.LATE: Row(
        _R.CONTINUE, "loop",
        "a tick begins so late that the next deadline must be skipped",
        "one deadline is skipped, and the true interval used",
        "nothing; if it is frequent, reduce the load of the computer",
    ),
    _C.OVERRUN: Row(
        _R.HOLD, "loop",
        "`overrun_ticks` deadlines missed, less half of the ticks on time",
        "the machine is too busy: setpoints are old, but still arrive",
        "reduce the load of the computer (`real time` in `contactctl status`), then `contactctl "
        "arm`",
    ),
    _C.ABSENT: Row(
        _R.QUICK_STOP, "loop",
        "no heartbeat of contactd for nearly as long as the drives wait for it "
        "(`master_timeout_ms`): the loop was held up, or the bus took no frame",
        "the drives may have stopped by themselves, and would run on at the next SYNC: each is "
        "first stopped by SDO, and has to confirm it",
        "find what held the daemon up (a debugger, a suspended computer) or blocked its bus, then "
        "`contactctl reset`",
        source=Kind.ABSENT,
    ),
    _C.PROGRAM_ERROR: Row(
        _R.FAULT_EXIT, "faults",
        "an exception anywhere in the loop; its traceback is in the log",
        "no data of the program can be relied on",
        "report it with the traceback and the black box; start contactd if systemd does not",
    ),
}  # fmt: skip
