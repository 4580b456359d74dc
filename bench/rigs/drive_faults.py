"""Faults of one drive: what it says, does and hears."""

from collections.abc import Iterator
from contextlib import contextmanager

from bench.rigs.breakable_arm import ELBOW, BreakableArm, Fault, for_ever
from simulator.state_machine import Trigger

OVER_CURRENT, UNDER_VOLTAGE, OVER_TEMPERATURE = 0x2310, 0x3220, 0x4310


def heartbeat_lost(on: BreakableArm) -> Iterator[None]:
    with on.losing(0x701 + ELBOW):
        yield from for_ever()


def emergency(code: int) -> Fault:
    def fault(on: BreakableArm) -> Iterator[None]:
        on.wire.add(0x081 + ELBOW, code.to_bytes(2, "little") + bytes([1, 0, 0, 0, 0, 0]))
        yield
        on.wire.add(0x081 + ELBOW, bytes(8))  # it is over

    return fault


def fault_bit(on: BreakableArm) -> Iterator[None]:
    with on.losing(0x081 + ELBOW):  # no emergency message: the statusword alone
        on.rig.arm.drives[ELBOW].fault(OVER_CURRENT, "over-current")
        yield from for_ever()


def emergency_stop(on: BreakableArm) -> Iterator[None]:
    on.rig.arm.drives[ELBOW].axis.happen(Trigger.DISABLE_VOLTAGE)
    yield


def left_operational(on: BreakableArm) -> Iterator[None]:
    on.rig.arm.drives[ELBOW].on_nmt(128)
    yield from for_ever()


def reboot(on: BreakableArm) -> Iterator[None]:
    on.rig.arm.drives[ELBOW].boot()
    yield from for_ever()


def runaway(on: BreakableArm) -> Iterator[None]:
    """A drive that does what it likes, but still knows the quick stop."""
    servo, axis = on.rig.arm.servo, on.rig.arm.drives[ELBOW].axis
    while axis.state.name == "OPERATION_ENABLED":
        servo.ramp(ELBOW, 3.2, 60.0)
        yield
    yield from for_ever()


@contextmanager
def _deaf(on: BreakableArm, *to: str) -> Iterator[None]:
    """The drive no longer hears these."""
    drive = on.rig.arm.drives[ELBOW]
    for method in to:
        setattr(drive, method, lambda *_: None)
    try:
        yield
    finally:
        for method in to:
            delattr(drive, method)


def deaf_to_setpoints(on: BreakableArm) -> Iterator[None]:
    """It answers every SYNC and hears our heartbeat, and goes on at its last velocity."""
    with _deaf(on, "on_pdo"):
        yield from for_ever()


def deaf_to_nmt_too(on: BreakableArm) -> Iterator[None]:
    """Nothing that we say stops it; our silence would."""
    with _deaf(on, "on_pdo", "on_nmt"):
        yield from for_ever()


def stone_deaf(on: BreakableArm) -> Iterator[None]:
    """It hears nothing at all, and sends its heartbeat."""
    with _deaf(on, "on_pdo", "on_nmt", "on_heartbeat", "transmit", "latch"):
        yield from for_ever()
