"""Faults of one drive: what it says, does and hears."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from bench.rigs import foreign_tool
from bench.rigs.breakable_arm import BreakableArm, Fault, for_ever, lasting, once, throughout
from bench.rigs.speech import HOT
from drivers.canopen.cia402 import VOLTAGE_ENABLED
from drivers.canopen.codec import transmit_pdos
from drivers.canopen.ids import EMERGENCY, ENTER_PRE_OPERATIONAL, HEARTBEAT, RPDO, START_NODE
from simulator.state_machine import Trigger

OTHER_MODE = {"romeo": 0, "desk arm": 3, "durand": 1}  # that they have, too


heartbeat_lost = throughout(lambda on: on.losing(HEARTBEAT + on.drive.node))


def emergency(code: int) -> Fault:
    def fault(on: BreakableArm) -> Iterator[None]:
        on.make.speech.emergency(on, code)
        yield
        on.make.speech.emergency(on, 0)  # it is over

    return fault


def fault_bit(on: BreakableArm) -> Iterator[None]:
    with on.losing(EMERGENCY + on.drive.node):  # no emergency message: the statusword alone
        on.make.speech.fail(on)
        yield from for_ever()


def false_statusword(word: int) -> Fault:
    """One frame brings another statusword than the drive's: the drive is as before."""

    def fault(on: BreakableArm) -> Iterator[None]:
        where = next(
            (pdo, place)
            for pdo in transmit_pdos(on.drive)
            for place, field in enumerate(pdo.fields)
            if field.entry == "statusword"
        )

        def falsified(can_id: int, data: bytes) -> bytes:
            pdo, place = where
            if can_id != pdo.cob_id:
                return data
            values = list(pdo.layout.unpack_from(data))
            values[place] = word
            return bytes(pdo.layout.pack(*values))

        with on.saying(falsified):
            yield

    return fault


def samples_repeat(on: BreakableArm) -> Iterator[None]:
    """Its PDOs repeat what they said, statusword and all; by SDO it says what is."""
    kept: dict[int, bytes] = {}
    answers, answer_kind, kin = (
        set(on.answers(on.drive)),
        on.make.speech.answer_kind,
        on.make.speech.kin,
    )

    def repeated(can_id: int, data: bytes) -> bytes:
        return (
            kept.setdefault(kin(can_id) << 8 | answer_kind(data), data)
            if kin(can_id) in answers
            else data
        )

    with on.saying(repeated):
        yield from for_ever()


emergency_stop = once(lambda on: on.simulated.axis.happen(Trigger.DISABLE_VOLTAGE))


def supply_gone(on: BreakableArm) -> Iterator[None]:
    """Its power stage has no voltage, and its logic goes on."""
    word = on.simulated.axis.statusword
    on.simulated.axis.statusword = lambda remote: word(remote) & ~VOLTAGE_ENABLED
    try:
        yield from for_ever()
    finally:
        on.simulated.axis.statusword = word


left_operational = lasting(lambda on: on.simulated.on_nmt(ENTER_PRE_OPERATIONAL))
reboot = lasting(lambda on: on.simulated.boot())


def restarts_unheard(on: BreakableArm) -> Iterator[None]:
    """It starts anew, and is operational by itself, with its heartbeat and the PDOs of its maker;
    its boot-up message is lost."""
    with on.losing(HEARTBEAT + on.drive.node):
        on.simulated.boot()
        on.simulated.on_nmt(START_NODE)
        on.simulated.on_sdo(foreign_tool.download(0x1017, on.drive.profile.heartbeat_ms, 2))
        yield
    yield from for_ever()


def restarts_operational(on: BreakableArm) -> Iterator[None]:
    """It starts anew and is operational by itself, takes our setpoint by the PDOs of its maker, for
    which it is too long, and says so late, by its inhibit time (0x1015)."""
    make = on.simulated.make
    on.simulated.make = replace(make, minds_longer=True, emergency_delay_s=1.6)
    try:
        on.simulated.boot()
        on.simulated.on_nmt(START_NODE)
        on.simulated.on_sdo(foreign_tool.download(0x1017, on.drive.profile.heartbeat_ms, 2))
        on.simulated.on_pdo(RPDO + on.drive.node, bytes(8))  # on its way when it started
        yield from for_ever()
    finally:
        on.simulated.make = make


# Another program chooses another mode of operation, turns the RPDO off that brings the target
# velocity, or gives SYNC another identifier (0x1005).
mode_changed = lasting(
    lambda on: on.simulated.on_sdo(foreign_tool.mode_changed(OTHER_MODE[on.make.name]))
)
rpdo_off = lasting(lambda on: on.make.speech.ignore_setpoints(on))
sync_moved = lasting(lambda on: on.simulated.on_sdo(foreign_tool.sync_moved()))
# It has missed its master, says that this is over, and takes no fault reset.
locked = lasting(lambda on: on.make.speech.lock(on))


def locked_and_slow(on: BreakableArm) -> Iterator[None]:
    """... and takes a while to boot when its communication is reset."""
    on.simulated.make = replace(on.simulated.make, boot_s=0.8)
    yield from locked(on)


def another_product(on: BreakableArm) -> Iterator[None]:
    """A drive of another product is put in its place, with nothing of its set-up."""
    right = on.rig.boot.identities[on.joint].product
    assert right is not None
    on.simulated.boot()
    on.simulated.put(0x1018, 2, 0x999)
    try:
        yield from for_ever()
    finally:
        on.simulated.boot()
        on.simulated.put(0x1018, 2, right)


def runaway(on: BreakableArm) -> Iterator[None]:
    """A drive that does what it likes, but still knows the quick stop, or that it is disabled."""
    if on.make.speech.stops_by_ramp:
        laws, joint = on.rig.arm._laws, on.joint

        def act() -> None:
            if on.make.speech.runs(on.simulated):
                laws.set_impedance(joint, 0.0, 3.2, 0.0, 5.0, 0.0)

        on.simulated._act = act
        try:
            yield from for_ever()
        finally:
            del on.simulated._act
    servo, axis = on.rig.arm.servo, on.simulated.axis
    while axis.state.name == "OPERATION_ENABLED":
        servo.ramp(on.joint, 3.2, 60.0)
        yield
    yield from for_ever()


def quick_stop_not_kept(on: BreakableArm) -> Iterator[None]:
    """A drive that says that it is in quick stop, and runs on; without power it cannot."""
    yield from _in_quick_stop(on, lambda _: 0.6)


def quick_stop_hunts(on: BreakableArm) -> Iterator[None]:
    """A drive that says that it is in quick stop, and swings to and fro three times a second."""
    yield from _in_quick_stop(on, lambda t: 0.6 * math.copysign(1.0, math.sin(6.0 * math.pi * t)))


def _in_quick_stop(on: BreakableArm, velocity: Callable[[float], float]) -> Iterator[None]:
    servo, axis, ticks = on.rig.arm.servo, on.simulated.axis, 0
    yield from emergency(HOT)(on)
    while servo.energised(on.joint) or axis.state.name == "QUICK_STOP_ACTIVE":
        servo.ramp(on.joint, velocity(ticks * on.period_s), 60.0)
        ticks += 1
        yield
    yield from for_ever()


@contextmanager
def _deaf(on: BreakableArm, to: str) -> Iterator[None]:
    """The drive no longer hears this."""
    drive, methods = on.simulated, on.make.speech.deaf(to)
    for method in methods:
        setattr(drive, method, lambda *_: None)
    try:
        yield
    finally:
        for method in methods:
            drive.__dict__.pop(method, None)


# It answers every SYNC and hears our heartbeat, and goes on at its last velocity.
deaf_to_setpoints = throughout(lambda on: _deaf(on, "setpoints"))
# An NMT stop is all that it hears; and not even that: our silence would stop it.
deaf_to_sdo_too = throughout(lambda on: _deaf(on, "set-up"))
deaf_to_nmt_too = throughout(lambda on: _deaf(on, "all but silence"))
# It never takes a setpoint, nor answers, and our heartbeat shows it that all is well.
deaf_to_sync = throughout(lambda on: _deaf(on, "requests"))
stone_deaf = throughout(lambda on: _deaf(on, "all"))  # and sends its heartbeat
