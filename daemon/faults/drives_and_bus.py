"""Rows of the table of faults for drives and bus."""

from typing import Final

from daemon.faults.conditions import Condition, Response, Row
from drivers.api import Kind

_C, _R = Condition, Response

DRIVES_AND_BUS: Final = {
    _C.SAMPLE_MISSING: Row(
        _R.CONTINUE, "samples",
        "a TPDO has not arrived when its tick decides, or all came later than usual",
        "one frame may be lost; its joint's interval extends to the next one, and the other "
        "joints sense. The sampling time of late ones is unknown",
        "nothing; if it is frequent, check cable, termination, and the bus load with `contactd "
        "check`; of all joints: the computer's load",
    ),
    _C.STALE: Row(
        _R.QUICK_STOP, "samples",
        "no TPDO of a drive for `stale_ticks` consecutive ticks, or in three times as many, minus "
        "those with one. After a start or a reset a drive has 30 ticks for its first; until then "
        "`contactctl status` shows the old values with their age",
        "the joint's state is unknown, and its drive may receive nothing",
        "check supply and CAN cable of the named drive, then `contactctl reset`",
    ),
    _C.NOT_SENSING: Row(
        _R.HOLD, "estimator",
        "a joint does not sense for 5 ticks; each tick in which all sense subtracts half a tick. "
        "It has had no samples for more than 2.5 periods, or its residual restarts. Or all "
        "answers are late in more than a third of the ticks, for seconds",
        "contacts there would not be detected",
        "`contactctl status` names the joint: check the cable of its drive, and the load of bus "
        "and computer; then `contactctl arm`",
    ),
    _C.STARVED: Row(
        _R.HOLD, "samples",
        "samples are stale while ticks are late, too; up to three times as long",
        "the machine was late, not the drive; standing still needs no samples",
        "reduce the load of the computer (`real time` in `contactctl status`), then `contactctl "
        "arm`",
    ),
    _C.OLD: Row(
        _R.HOLD, "samples",
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
        _R.QUICK_STOP, "heartbeats",
        "nothing received from a drive for three of its heartbeats",
        "its program, supply or cable has failed",
        "check supply and CAN cable of the drive, then `contactctl reset`, which sets it up again",
        source=Kind.SILENT,
    ),
    _C.UNHEARD: Row(
        _R.QUICK_STOP, "heartbeats",
        "an EMCY message with code 0x8130: a drive missed contactd's heartbeat "
        "(`master_timeout_ms`). On a loaded bus the load and its source are shown",
        "that drive has stopped by itself; others will",
        "if a bus load is shown, find who sends those frames, and switch it off; else check CAN "
        "cable and termination of the named drive, and `real time` in `contactctl status`; then "
        "`contactctl reset`",
        source=Kind.UNHEARD,
    ),
    _C.UNGUARDED: Row(
        _R.HOLD, "heartbeats",
        "no heartbeat of the guardian on the bus for 100 ms, after it had been there. Only for "
        "drives that lose torque when nothing is sent to them",
        "if this process died, too, the arm would fall",
        "start `contactd guard` again (its service, or its terminal), then `contactctl arm`",
        source=Kind.UNGUARDED,
    ),
    _C.EMERGENCY: Row(
        _R.QUICK_STOP, "emergencies",
        "an EMCY message with an error code (over-current, under-voltage, over-temperature, ...). "
        "Protocol errors (0x82xx) do not count for half a second after the set-up of the drive "
        "was read back, as they concern earlier frames",
        "the drive may be about to fail",
        "look up the code in the drive's manual, remove the cause, then `contactctl reset`",
        source=Kind.ERROR,
    ),
    _C.DRIVE_FAULT: Row(
        _R.QUICK_STOP, "drives",
        "a statusword reports fault or fault reaction",
        "one joint has stopped or lost its torque; the others must not continue",
        "look up the drive's error (the log, its maker's tool), remove its cause, then "
        "`contactctl reset`",
    ),
    _C.DRIVE_DROPPED: Row(
        _R.QUICK_STOP, "drives",
        "a drive that should run is not in operation enabled, or not operational",
        "something else switched it, such as an emergency stop",
        "release the emergency stop, or close the tool that switched it, then `contactctl reset`",
        source=Kind.DROPPED,
    ),
    _C.SUPPLY_LOST: Row(
        _R.QUICK_STOP, "drives",
        "a drive that should run clears bit 4 of its statusword (voltage enabled), for two "
        "samples if it reports operation enabled; only for drives that have set it before",
        "its motor has no torque: the joint falls, or stands in its brake; the others must not "
        "continue",
        "check the emergency stop, then supply, fuse and contactor of the named drive; a supply "
        "that breaks down while the arm accelerates is too weak; then `contactctl reset`",
    ),
    _C.NOT_FOLLOWING: Row(
        _R.QUICK_STOP, "drives",
        "for 20 ticks a motor's velocity differs from its setpoints by more than "
        "`following_margin` times its velocity limit, and its current does not push the right "
        "way with half of its limit (for half a second after enabling: has not changed that way "
        "at all)",
        "the drive sends, but does not receive setpoints, or does not obey them; or a push is "
        "stronger than its motor",
        "let go of the arm, close other tools on the bus, then `contactctl reset`; a drive with "
        "a soft velocity loop needs a larger margin: docs/porting.md, step 8",
    ),
    _C.IGNORES_SETPOINT: Row(
        _R.QUICK_STOP, "drives",
        "a drive in operation clears bit 12 of its statusword (follows the command) for three "
        "ticks, with less than half of its current; only for drives that have set it",
        "another tool has chosen another mode of operation, or halted it",
        "close other tools on the bus, then `contactctl reset`: the log names the changed object, "
        "and the drive is set up again",
    ),
    _C.NOT_SEEN_TO_STOP: Row(
        _R.QUICK_STOP, "drives",
        "a drive was commanded to stop, by its setpoint and by SDO, and for some ticks no fresh "
        "statusword shows that it left operation; or one shows it, and the drive keeps moving",
        "it gets an NMT stop, at which a drive stops by itself (0x6007), and is asked by SDO; one "
        "that reports a stop, but moves beyond its travel, loses its power",
        "keep away from the arm, and press the emergency stop if it moves; check supply and CAN "
        "cable of the drive, close other tools on the bus, then `contactctl reset`",
        source=Kind.NOT_SEEN_TO_STOP,
    ),
    _C.UNPROVED: Row(
        _R.QUICK_STOP, "drives",
        "no proof after the NMT stop either; or a joint commanded to stop is about to go further "
        "than `contactd check` prints",
        "the last resort: no heartbeat, SYNC or setpoint to any drive until `reset`, so that "
        "each stops by itself (0x1016, 0x6007)",
        "press the emergency stop if anything moves; find out why the drive cannot be heard; then "
        "`contactctl reset`, which sets up all drives again. Before a drive that went on moving "
        "moves an arm again, test on the bench that it stops without its master: docs/porting.md, "
        "step 9",
        source=Kind.UNPROVED,
    ),
    _C.REBOOTED: Row(
        _R.QUICK_STOP, "set-up",
        "a boot-up message",
        "the drive lost its set-up; `reset` sets it up again",
        "find out why it restarted (supply, plug, emergency stop), then `contactctl reset`",
        source=Kind.RESTARTED,
    ),
    _C.FOREIGN_MASTER: Row(
        _R.QUICK_STOP, "faults",
        "SYNC, NMT, a setpoint or the master's heartbeat from another sender",
        "with two masters it is unknown whose setpoints the drives follow",
        "close the other master (a maker's tool, a second daemon), then `contactctl reset`",
        source=Kind.FOREIGN_MASTER,
    ),
    _C.TWO_DRIVES: Row(
        _R.QUICK_STOP, "faults",
        "a drive answers five SYNCs in a row twice; at the start, in a reset and in `contactd "
        "scan`, its SDO requests",
        "their measurements cannot be distinguished, and both take the same setpoints",
        "switch one drive off, give it a node number of its own with its maker's tool, check with "
        "`contactd scan` that each answers once; then `contactctl reset`",
        source=Kind.TWO_DRIVES,
    ),
    _C.BUS_LOADED: Row(
        _R.CONTINUE, "faults",
        "frames of others and the arm's own PDOs take more than 80 % of the bus, averaged over 50 "
        "ms, without stuff bits; their number and most frequent identifier are shown",
        "nothing is wrong while samples and heartbeats arrive; the arm stops when they do not",
        "find who sends those frames (`candump can0`), and switch it off or make it send less",
        source=Kind.LOADED,
    ),
    _C.BUS_DISTURBED: Row(
        _R.CONTINUE, "faults",
        "sending or receiving fails (ENOBUFS), an error frame, an answer a period late",
        "it may be over with the next frame",
        "nothing; if it is frequent, check cable, termination, and the bus load with `contactd "
        "check`",
    ),
    _C.BUS_TROUBLE: Row(
        _R.QUICK_STOP, "faults",
        "the bus is disturbed in `stale_ticks` consecutive ticks",
        "setpoints may not arrive; the quick stop goes out with the first frame that passes",
        "check that the interface is up (`ip link`), the drives have power, and the cable is "
        "whole and terminated; then `contactctl reset`",
    ),
    _C.ERROR_PASSIVE: Row(
        _R.HOLD, "faults",
        "an error frame reports that the CAN controller is error-passive",
        "samples and setpoints still pass",
        "check cable, termination (120 ohm at both ends) and bitrate, then `contactctl arm`",
        source=Kind.PASSIVE,
    ),
    _C.BUS_OFF: Row(
        _R.QUICK_STOP, "faults",
        "an error frame reports that the CAN controller has left the bus",
        "nothing is sent any more; the drives miss the heartbeat and stop by themselves",
        "look for a short circuit, missing termination or a wrong bitrate; check that the "
        "interface is up again (`ip link`); then `contactctl reset`",
        source=Kind.OFF_BUS,
    ),
    _C.ADAPTER_GONE: Row(
        _R.FAULT_EXIT, "faults",
        "the socket reports that its device or its peer is gone",
        "the bus must be opened, and the drives set up, again",
        "plug the adapter in again, or start the gateway; start contactd if systemd does not",
        source=Kind.ADAPTER_GONE,
    ),
}  # fmt: skip
