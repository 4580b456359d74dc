"""Every condition of the table of faults, made to happen in lockstep.

Faults of processes (SIGSTOP, SIGKILL, a second daemon) are no part of it.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from bench.rigs.breakable_arm import BreakableArm, Fault
from bench.rigs.bus_faults import (
    adapter_gone,
    bus_down,
    bus_off,
    enobufs,
    error_passive,
    foreign,
    old_frames,
    one_enobufs,
    one_pdo_missing,
    pdos_lost_in_turn,
    pdos_stale,
    pdos_stale_on_a_late_machine,
)
from bench.rigs.drive_faults import (
    OVER_TEMPERATURE,
    UNDER_VOLTAGE,
    deaf_to_nmt_too,
    deaf_to_setpoints,
    emergency,
    emergency_stop,
    fault_bit,
    heartbeat_lost,
    left_operational,
    reboot,
    runaway,
    stone_deaf,
)
from bench.rigs.measurement_faults import (
    encoder_frozen,
    encoder_jump,
    gear_slips,
    hit_hard,
    infinite_reference,
    not_a_number,
    pushed_beyond_a_limit,
    torque_saturated,
    torque_stuck,
)
from daemon.faults.table import Condition


def late(seconds: float) -> Fault:
    def fault(on: BreakableArm) -> Iterator[None]:
        with on.late(seconds):
            yield

    return fault


def late_ticks(on: BreakableArm) -> Iterator[None]:
    with on.late(0.012):
        for _ in range(8):
            yield


@dataclass(frozen=True, slots=True)
class Case:
    """A fault, the condition that it must be found as, and after how many ticks at most (the tick
    in which it happens counts as the first)."""

    name: str
    condition: Condition
    fault: Fault
    ticks: int
    armed: bool = True
    recovers: bool = True
    """Whether `reset` and `enable` are enough once its cause is gone."""
    before: tuple[Condition, ...] = ()
    """What is found of it sooner, and latched."""


_C = Condition
CASES = (
    Case("one PDO missing", _C.SAMPLE_MISSING, one_pdo_missing, 1),
    Case("a drive's PDOs missing", _C.STALE, pdos_stale, 3),
    Case("... on a late machine", _C.STARVED, pdos_stale_on_a_late_machine, 3),
    Case("PDOs missing in turn", _C.STALE, pdos_lost_in_turn, 9),
    Case("heartbeat of a drive lost", _C.HEARTBEAT_LOST, heartbeat_lost, 21),
    Case("over-temperature", _C.EMERGENCY, emergency(OVER_TEMPERATURE), 1),
    Case("under-voltage", _C.EMERGENCY, emergency(UNDER_VOLTAGE), 1),
    Case("fault bit", _C.DRIVE_FAULT, fault_bit, 1),
    Case("emergency stop of a drive", _C.DRIVE_DROPPED, emergency_stop, 1),
    Case("drive deaf to setpoints", _C.NOT_FOLLOWING, deaf_to_setpoints, 45, recovers=False),
    Case(
        "... and to quick stops",
        _C.DISOBEDIENT,
        deaf_to_setpoints,
        52,
        recovers=False,
        before=(_C.NOT_FOLLOWING,),
    ),
    Case(
        "... and to NMT",
        _C.UNSTOPPABLE,
        deaf_to_nmt_too,
        58,
        recovers=False,
        before=(_C.NOT_FOLLOWING, _C.DISOBEDIENT),
    ),
    Case("drive stone-deaf", _C.STALE, stone_deaf, 3, recovers=False),
    Case("drive leaves operational", _C.STALE, left_operational, 3, recovers=False),
    Case("drive restarts", _C.REBOOTED, reboot, 1, recovers=False),
    Case("foreign SYNC", _C.FOREIGN_MASTER, foreign(0x080), 1),
    Case("foreign NMT command", _C.FOREIGN_MASTER, foreign(0x000, b"\x80\x03"), 1),
    Case("foreign setpoint", _C.FOREIGN_MASTER, foreign(0x203, bytes(6)), 1),
    Case("ENOBUFS once", _C.BUS_DISTURBED, one_enobufs, 1),
    Case("ENOBUFS for 3 ticks", _C.BUS_TROUBLE, enobufs, 4),
    Case("network down", _C.BUS_TROUBLE, bus_down, 4),
    Case("old frames come back", _C.STALE, old_frames, 3),
    Case("error-passive", _C.ERROR_PASSIVE, error_passive, 1),
    Case("bus-off", _C.BUS_OFF, bus_off, 1),
    Case("NaN in the estimate", _C.NOT_FINITE, not_a_number, 1),
    Case("infinite reference", _C.NOT_FINITE, infinite_reference, 2),
    Case("encoder jump of 0.2 rad", _C.JUMP, encoder_jump, 1),
    Case("encoder frozen", _C.FROZEN, encoder_frozen, 60),
    Case("gear slips at 0.8 rad/s", _C.APART, gear_slips, 9),
    Case("current stuck", _C.TORQUE_STUCK, torque_stuck, 150, armed=False),
    Case("current at its limit", _C.TORQUE_SATURATED, torque_saturated, 20, armed=False),
    Case("hit of 9 Nm", _C.RESIDUAL_LIMIT, hit_hard, 15),
    Case("drive runs away", _C.OVERSPEED, runaway, 15),
    Case("pushed beyond a limit", _C.JOINT_LIMIT, pushed_beyond_a_limit, 100),
    Case("one late tick", _C.LATE, late(0.012), 1),
    Case("8 late ticks", _C.OVERRUN, late_ticks, 5),
    Case("60 ms late", _C.OVERRUN, late(0.060), 1),
    Case("stood still for 150 ms", _C.SUSPENDED, late(0.150), 1),
    Case("adapter gone", _C.ADAPTER_GONE, adapter_gone, 1, recovers=False),
)
