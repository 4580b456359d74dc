"""Every condition of the table of faults, made to happen in lockstep.

A case is shown on the drives of every make, and on those of one make over the wire of every
interface, or `EXCLUDED` says why not. Faults of processes (SIGSTOP, SIGKILL, a second daemon) are
no part of it.
"""

from contextlib import AbstractContextManager
from dataclasses import dataclass

from bench.rigs import bus_faults as bus
from bench.rigs import drive_faults as drive
from bench.rigs import measurement_faults as measured
from bench.rigs.breakable_arm import MAKES, BreakableArm, Fault, Make, stage, throughout
from bench.rigs.lines import LINES
from bench.rigs.speech import HOT, SUPPLY
from daemon.faults.conditions import Condition


def late(seconds: float, ticks: int = 1) -> Fault:
    return throughout(lambda on: on.late(seconds), ticks)


@dataclass(frozen=True, slots=True)
class Case:
    """A fault, the condition that it must be found as, and after how many ticks at most (the tick
    in which it happens counts as the first)."""

    name: str
    condition: Condition
    fault: Fault
    ticks: int
    armed: bool = True
    before: tuple[Condition, ...] = ()  # What is found of it sooner, and latched.
    provable: bool = True  # something can say that the drive stands; else only silence is left
    by_motor: bool = False  # a stand is proved only where the motor's position is reported
    by_sdo: bool = False  # ... only where a drive can be asked beside its samples
    obeys: bool = False
    """Whether the drive says that it obeys and nothing says where it is: then it is neither proved
    to stand nor silenced, as silence would ask no more of it."""
    driven: bool = False  # a hand is faster than any setpoint: what is printed may be exceeded
    own: bool = False  # Whether the drive does: then it is held against what is printed for that.
    frames: bool = False  # made, or shown, in frames: every wire has to carry it


_C = Condition
CASES = (
    Case("one PDO missing", _C.SAMPLE_MISSING, bus.one_pdo_missing, 1, frames=True),
    Case("a drive's PDOs missing", _C.STALE, bus.pdos_stale, 3, frames=True, by_sdo=True),
    Case("... on a late machine", _C.STARVED, bus.pdos_stale_on_a_late_machine, 3),
    Case("... now and then on a late machine", _C.NOT_SENSING, bus.deaf_on_a_late_machine, 8),
    Case("PDOs missing in turn", _C.SAMPLE_MISSING, bus.pdos_lost_in_turn, 1, frames=True),
    Case("PDOs missing in most ticks", _C.STALE, bus.pdos_lost_in_most_ticks, 27, frames=True),
    Case("heartbeat of a drive lost", _C.HEARTBEAT_LOST, drive.heartbeat_lost, 21, frames=True),
    Case("over-temperature", _C.EMERGENCY, drive.emergency(HOT), 1, frames=True),
    Case("under-voltage", _C.EMERGENCY, drive.emergency(SUPPLY), 1, frames=True),
    Case("fault bit", _C.DRIVE_FAULT, drive.fault_bit, 1, frames=True),
    Case("emergency stop of a drive", _C.DRIVE_DROPPED, drive.emergency_stop, 1, frames=True),
    Case("statusword false once: stops", _C.DRIVE_DROPPED, drive.false_statusword(0x0217), 1),
    Case("... switched on", _C.DRIVE_DROPPED, drive.false_statusword(0x0233), 1),
    Case("... without power", _C.DRIVE_DROPPED, drive.false_statusword(0x0250), 1),
    Case("... fault", _C.DRIVE_FAULT, drive.false_statusword(0x0218), 1),
    Case("drive deaf to setpoints", _C.NOT_FOLLOWING, drive.deaf_to_setpoints, 45),
    Case("... and to SDO", _C.NOT_SEEN_TO_STOP, drive.deaf_to_sdo_too, 60, provable=False,
         before=(_C.NOT_FOLLOWING,)),
    Case("... and to NMT", _C.UNPROVED, drive.deaf_to_nmt_too, 70, provable=False,
         before=(_C.NOT_FOLLOWING, _C.NOT_SEEN_TO_STOP)),
    Case("quick stop said, and not kept", _C.NOT_SEEN_TO_STOP, drive.quick_stop_not_kept, 60,
         before=(_C.EMERGENCY,), own=True),
    Case("quick stop said, and hunts", _C.NOT_SEEN_TO_STOP, drive.quick_stop_hunts, 60,
         before=(_C.EMERGENCY,), own=True),
    Case("drive stone-deaf", _C.STALE, drive.stone_deaf, 3, provable=False),
    Case("drive leaves operational", _C.STALE, drive.left_operational, 3,
         before=(_C.DRIVE_DROPPED,), frames=True),
    Case("drive restarts", _C.REBOOTED, drive.reboot, 1, frames=True),
    Case("... unheard, and starts by itself", _C.STALE, drive.restarts_unheard, 3, frames=True),
    Case("... heard, says late that a PDO was too long", _C.REBOOTED, drive.restarts_operational,
         1),
    Case("another product in its place", _C.REBOOTED, drive.another_product, 1, frames=True),
    Case("drive locked in 0x8130", _C.UNHEARD, drive.locked, 1, frames=True),
    Case("... and slow to boot", _C.UNHEARD, drive.locked_and_slow, 1, frames=True),
    Case("drive without supply", _C.SUPPLY_LOST, drive.supply_gone, 2),
    Case("mode changed by a tool (0x6060)", _C.IGNORES_SETPOINT, drive.mode_changed, 4),
    Case("setpoints turned off by a tool", _C.NOT_FOLLOWING, drive.rpdo_off, 60),
    Case("drive deaf to SYNC", _C.STALE, drive.deaf_to_sync, 3, by_sdo=True),
    Case("SYNC moved by a tool (0x1005)", _C.STALE, drive.sync_moved, 3),
    Case("SYNC lost", _C.STALE, bus.sync_lost, 3, frames=True, by_sdo=True),
    Case("a drive answers a period late", _C.OLD, bus.answers_a_period_late, 12, frames=True),
    Case("two drives with one node", _C.TWO_DRIVES, bus.two_drives, 7, frames=True),
    Case("foreign SYNC, or request", _C.FOREIGN_MASTER, bus.foreign_request, 1, frames=True),
    Case("foreign NMT command, or disable", _C.FOREIGN_MASTER, bus.foreign_command, 1, frames=True),
    Case("foreign setpoint", _C.FOREIGN_MASTER, bus.foreign_setpoint, 1, frames=True),
    Case("bus flooded", _C.BUS_LOADED, bus.flooded, 12, frames=True),
    Case("... and a drive misses us", _C.UNHEARD, bus.flooded_and_unheard, 14, frames=True),
    Case("ENOBUFS once", _C.BUS_DISTURBED, bus.one_enobufs, 1, frames=True),
    Case("ENOBUFS for 3 ticks", _C.BUS_TROUBLE, bus.enobufs, 4, frames=True),
    Case("network down", _C.BUS_TROUBLE, bus.bus_down, 4, frames=True),
    Case("old frames come back", _C.STALE, bus.old_frames, 3, frames=True),
    Case("error-passive", _C.ERROR_PASSIVE, bus.error_passive, 1, frames=True),
    Case("bus-off", _C.BUS_OFF, bus.bus_off, 1, frames=True),
    Case("... for 30 ms", _C.BUS_OFF, bus.bus_off_for(0.03), 1, frames=True),
    Case("... for 80 ms", _C.BUS_OFF, bus.bus_off_for(0.08), 1, frames=True),
    Case("... for 400 ms", _C.BUS_OFF, bus.bus_off_for(0.4), 1, frames=True),
    Case("unheard for 80 ms", _C.STALE, bus.unheard_for(0.08), 3, frames=True),
    Case("unheard for 400 ms", _C.STALE, bus.unheard_for(0.4), 3, frames=True),
    Case("NaN in the estimate", _C.NOT_FINITE, measured.not_a_number, 1),
    Case("infinite reference", _C.NOT_FINITE, measured.infinite_reference, 2),
    Case("encoder jump of 0.2 rad", _C.JUMP, measured.encoder_jump, 1),
    Case("encoder frozen", _C.FROZEN, measured.encoder_frozen, 60, by_motor=True, obeys=True),
    Case("everything measured frozen", _C.FROZEN, measured.all_frozen, 12, provable=False,
         obeys=True),
    Case("every encoder dark", _C.NOT_FOLLOWING, measured.encoders_dark, 45, provable=False,
         obeys=True),
    Case("PDOs repeat themselves", _C.FROZEN, drive.samples_repeat, 12, frames=True, by_sdo=True),
    Case("gear slips at 0.8 rad/s", _C.APART, measured.gear_slips, 9),
    Case("current stuck", _C.TORQUE_STUCK, measured.torque_stuck, 150, armed=False),
    Case("current at its limit", _C.TORQUE_SATURATED, measured.torque_saturated, 20, armed=False),
    Case("hard hit", _C.RESIDUAL_LIMIT, measured.hit_hard, 15, driven=True),
    Case("drive runs away", _C.OVERSPEED, drive.runaway, 15, own=True),
    Case("pushed beyond a limit", _C.JOINT_LIMIT, measured.pushed_beyond_a_limit, 100, driven=True),
    Case("one late tick", _C.LATE, late(0.012), 1),
    Case("8 late ticks", _C.OVERRUN, late(0.012, ticks=8), 5),
    Case("60 ms late", _C.OVERRUN, late(0.060), 1),
    Case("stood still for 90 ms", _C.ABSENT, late(0.090), 1),
    Case("stood still for 150 ms", _C.ABSENT, late(0.150), 1),
    Case("stood still for 300 ms", _C.ABSENT, late(0.300), 1),
    Case("stood still for 3 s", _C.ABSENT, late(3.0), 1),
    Case("adapter gone", _C.ADAPTER_GONE, bus.adapter_gone, 1, frames=True),
)  # fmt: skip

NO_FRAMES = "the daemon alone makes it, or a sensor: the frames are ordinary ones"

_NO_ERRORS = "slcan has no error frames"
_NO_SWITCH = "the stack has no switch for it; the wire loses SYNC for all in another case"
_NO_BIT_12 = "its statusword does not say whether it follows"
_NO_6007 = "the stack does nothing by itself when it leaves NMT operational (0x6007)"
_NO_BIT_4 = "its statusword does not say whether it is supplied"
_ASKED = "these motors say nothing unasked: no heartbeat, no boot-up message"
_ONE_STATUS = "its only word is the status in its feedback: test_false_feedback.py"
_LIMP = "without setpoints these motors let go, and say so: another case"
_NO_STOP = "a motor that reports an error has no power; one that runs on is another case"
_NO_PLANT = "its motor follows its setpoints at once: there is nothing that could be pushed"

# (case, make or wire): why it cannot be shown there.
EXCLUDED: dict[tuple[str, str], str] = {
    ("current at its limit", "desk arm"): "with less than its current a motor reaches the "
    "collision level, which stops the arm before",
    ("current at its limit", "damiao"): "what nothing bears is a residual beyond its limit",
    ("heartbeat of a drive lost", "damiao"): _ASKED,
    (
        "pushed beyond a limit",
        "damiao",
    ): "its setpoint draws back before the limit, until the residual is beyond its own",
    (
        "emergency stop of a drive",
        "damiao",
    ): "one that is off has lost its set-up: another case",
    ("fault bit", "damiao"): "an error is in its status, which is found as such: another case",
    ("statusword false once: stops", "damiao"): _ONE_STATUS,
    ("... switched on", "damiao"): _ONE_STATUS,
    ("... without power", "damiao"): _ONE_STATUS,
    ("... fault", "damiao"): _ONE_STATUS,
    ("drive deaf to setpoints", "damiao"): _LIMP,
    ("... and to SDO", "damiao"): _LIMP,
    ("... and to NMT", "damiao"): _LIMP,
    ("quick stop said, and not kept", "damiao"): _NO_STOP,
    ("quick stop said, and hunts", "damiao"): _NO_STOP,
    ("drive leaves operational", "damiao"): "it has one state with power",
    ("... unheard, and starts by itself", "damiao"): _ASKED,
    ("... heard, says late that a PDO was too long", "damiao"): _ASKED,
    ("another product in its place", "damiao"): "a motor does not name its product",
    ("... and slow to boot", "damiao"): "it answers as soon as it has power",
    ("drive without supply", "damiao"): "it reports under-voltage, an error: another case",
    (
        "mode changed by a tool (0x6060)",
        "damiao",
    ): "no answer names its mode: it takes no setpoint, another case",
    ("SYNC moved by a tool (0x1005)", "damiao"): "it is asked by its own id",
    ("PDOs missing in turn", "durand"): "one drive has none to take turns with",
    ("drive deaf to setpoints", "durand"): _NO_6007,
    ("... and to SDO", "durand"): _NO_6007,
    ("... and to NMT", "durand"): _NO_6007,
    ("drive stone-deaf", "durand"): _NO_6007,
    ("drive leaves operational", "durand"): _NO_6007,
    ("drive deaf to SYNC", "durand"): _NO_SWITCH,
    ("stood still for 90 ms", "desk arm"): "its drives wait for 120 ms",
    ("... and slow to boot", "durand"): "the stack boots at once",
    ("... heard, says late that a PDO was too long", "durand"): "the stack has no EMCY of its own "
    "for it, and no inhibit time",
    ("SYNC moved by a tool (0x1005)", "desk arm"): "its drives have no object for it",
    ("mode changed by a tool (0x6060)", "durand"): _NO_BIT_12,
    ("drive without supply", "durand"): _NO_BIT_4,
    ("current at its limit", "durand"): "what nothing bears is a residual beyond its limit",
    ("hard hit", "durand"): _NO_PLANT,
    ("quick stop said, and not kept", "durand"): _NO_PLANT,
    ("quick stop said, and hunts", "durand"): _NO_PLANT,
    ("drive runs away", "durand"): _NO_PLANT,
    ("pushed beyond a limit", "durand"): _NO_PLANT,
    ("network down", "socketcand"): "only a network interface goes down; this one is gone then",
    ("network down", "slcan"): "only a network interface goes down; this one is gone then",
    ("error-passive", "slcan"): _NO_ERRORS,
    ("bus-off", "slcan"): _NO_ERRORS,
    ("... for 30 ms", "slcan"): _NO_ERRORS,
    ("... for 80 ms", "slcan"): _NO_ERRORS,
    ("... for 400 ms", "slcan"): _NO_ERRORS,
}
_NO_LINK = "it has no encoder of the link"
_NO_MISS = "it reports no missed master: it is off then, another case"
EXCLUDED |= {
    **{(case, "robstride"): why for (case, where), why in EXCLUDED.items() if where == "damiao"},
    ("encoder jump of 0.2 rad", "robstride"): _NO_LINK,
    ("encoder frozen", "robstride"): _NO_LINK,
    ("gear slips at 0.8 rad/s", "robstride"): _NO_LINK,
    ("hard hit", "robstride"): "found as a position that changed by more than it can move",
    ("drive locked in 0x8130", "robstride"): _NO_MISS,
    ("... and a drive misses us", "robstride"): _NO_MISS,
    ("drive deaf to SYNC", "robstride"): "its request is an order like others",
    ("setpoints turned off by a tool", "robstride"): "found; it is refused until its power is off",
    ("SYNC lost", "robstride"): "its requests are its setpoints: it hears nothing, another case",
}


@dataclass(frozen=True, slots=True)
class MakeOnWire:
    """Drives of one make, and the wire of one interface to them."""

    make: Make
    wire: str

    def __str__(self) -> str:
        return f"{self.make.name}, {self.wire}"

    def stage(self, speed: float = 0.0) -> AbstractContextManager[BreakableArm]:
        """A booted arm of this make on this wire."""
        return stage(self.make, LINES[self.wire], speed)


@dataclass(frozen=True, slots=True)
class Trial:
    """A case at one place."""

    place: MakeOnWire
    case: Case

    def __str__(self) -> str:
        return f"{self.place}, {self.case.name}"

    @property
    def excluded(self) -> str:
        """Reason why it cannot be shown; empty if it can."""
        name, place = self.case.name, self.place
        alike = NO_FRAMES if place.wire != "virtual" and not self.case.frames else ""
        where = (place.make.name, place.wire)
        return next(filter(None, (EXCLUDED.get((name, each)) for each in where)), alike)


PLACES = (
    *(MakeOnWire(make, "virtual") for make in MAKES),
    *(MakeOnWire(MAKES[0], wire) for wire in LINES if wire != "virtual"),
)
TRIALS = tuple(Trial(place, case) for place in PLACES for case in CASES)
SHOWN = tuple(shown for shown in TRIALS if not shown.excluded)
