"""Set-up proved by reading it back: what a drive lost or was written by others is named and
repaired, and one reset is enough."""

from collections.abc import Iterator

import numpy as np
import pytest

from bench.rigs.breakable_arm import DESK, DURAND, ROMEO_ARM, BreakableArm, Fault, Make, stage
from bench.rigs.drive_faults import (
    another_product,
    fault_bit,
    left_operational,
    locked,
    locked_and_slow,
    mode_changed,
    reboot,
    restarts_operational,
    restarts_unheard,
    rpdo_off,
)
from common.errors import DriveError
from daemon.modes.table import Event, Mode
from drivers.api import Kind
from drivers.canopen.codec import receive_pdos
from drivers.canopen.ids import EMERGENCY, SYNC

STANDS = 0.02  # [rad/s]
FAULTS: dict[str, Fault] = {
    "restarts": reboot,
    "restarts unheard": restarts_unheard,
    "restarts, and complains late": restarts_operational,
    "leaves operational": left_operational,
    "mode changed": mode_changed,
    "PDO turned off": rpdo_off,
    "locked": locked,
    "locked and slow": locked_and_slow,
}
CANOPEN = (ROMEO_ARM, DESK, DURAND)
IN_MOTION = [
    *(pytest.param(ROMEO_ARM, fault, id=f"romeo, {name}") for name, fault in FAULTS.items()),
    *(pytest.param(make, reboot, id=f"{make.name}, restarts") for make in (DESK, DURAND)),
]


@pytest.fixture
def on(make: Make) -> Iterator[BreakableArm]:
    with stage(make) as on:
        yield on


def enable(on: BreakableArm) -> None:
    """From off, as for a client."""
    assert on.rig.ask(Event.ENABLE) == []
    on.run(0.5)
    assert on.rig.mode is Mode.HOLDING, on.rig.tick.controller.machine.cause


def begin(on: BreakableArm) -> None:
    """From off: enabled, and all joints moving."""
    enable(on)
    on.rig.request(Event.START)
    on.run(0.25)
    assert on.rig.mode is Mode.TRACKING, on.rig.tick.controller.machine.cause


def goes_wrong(on: BreakableArm, fault: Fault, seconds: float = 1.5) -> Iterator[None]:
    """Until it is found, or something else is, and the arm has stopped; the fault goes on."""
    going = fault(on)
    for i in range(round(seconds / on.period_s)):
        next(going)
        if i == 80 and on.rig.mode is Mode.TRACKING:
            on.say(EMERGENCY + on.drives[-1].node, bytes([0x10, 0x42, 1, 0, 0, 0, 0, 0]))
        on.tick()
    assert on.rig.mode is Mode.FAULTED
    assert on.speed < STANDS
    return going


@pytest.mark.parametrize(("make", "fault"), IN_MOTION)
def test_one_reset_is_enough(on: BreakableArm, fault: Fault) -> None:
    begin(on)
    goes_wrong(on, fault)
    on.rig.reset()
    assert not any(drive.condition.in_fault for drive in on.rig.samples.drives)
    enable(on)


@pytest.mark.parametrize("make", [ROMEO_ARM, DESK], ids=lambda make: make.name)
def test_one_reset_is_enough_where_an_error_hides_a_locked_drive(on: BreakableArm) -> None:
    begin(on)
    goes_wrong(on, locked)
    next(fault_bit(on))
    on.run(0.1)
    on.rig.reset()
    enable(on)


@pytest.mark.parametrize("make", [ROMEO_ARM, DESK], ids=lambda make: make.name)
def test_a_slow_drive_is_awaited_and_no_other_misses_the_master(on: BreakableArm) -> None:
    begin(on)
    goes_wrong(on, locked_and_slow)
    before = on.rig.arm.now
    assert on.rig.ask(Event.RESET) == []
    assert on.rig.arm.now - before > 0.8
    on.tick()
    assert on.rig.samples.events == ()


@pytest.mark.parametrize("make", CANOPEN, ids=lambda make: make.name)
def test_a_drive_with_lost_settings_gets_no_setpoint_until_it_is_set_up(
    on: BreakableArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    next(mode_changed(on))

    def refused(*_: object) -> None:
        raise DriveError("it refuses")

    with monkeypatch.context() as patch:
        patch.setattr(type(on.rig.boot), "renew", refused)
        assert on.rig.ask(Event.ENABLE) == ["it refuses"]
    on.tick()
    assert on.drive.node not in on.setpoints()
    assert on.rig.drives.restarted() == (on.drive.name,)
    enable(on)


WORDS = {
    "restarts unheard": "object 0x1016:01 (watch the master's heartbeat) reads 0, must be",
    "mode changed": "object 0x6060:00 (cyclic synchronous velocity) reads {mode}, must be 9: ",
    "PDO turned off": "object 0x140{rpdo}:01 (COB-ID of RPDO",
}


@pytest.mark.parametrize("make", CANOPEN, ids=lambda make: make.name)
@pytest.mark.parametrize("name", WORDS)
def test_a_change_while_off_is_named_and_repaired_at_enable(
    on: BreakableArm, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    fault = FAULTS[name](on)
    next(fault)
    on.tick()
    next(fault)
    assert on.rig.mode is Mode.OFF
    caplog.clear()
    assert on.rig.ask(Event.ENABLE) == []
    mode = {"romeo": 0, "desk arm": 3, "durand": 1}[on.make.name]
    rpdo = len(receive_pdos(on.drive)) - 1  # the one with the target velocity
    words = WORDS[name].format(mode=mode, rpdo=rpdo)
    where = f"node {on.drive.node} ({on.drive.name}): {words}"
    assert where in caplog.text
    on.run(0.5)
    assert on.rig.mode is Mode.HOLDING, on.rig.tick.controller.machine.cause


@pytest.mark.parametrize("make", CANOPEN, ids=lambda make: make.name)
def test_drives_with_all_settings_are_only_read(on: BreakableArm) -> None:
    """Not one object is written, and no drive is commanded to leave operational."""
    written, reported = [], []
    for drive in on.rig.arm.drives:
        if hasattr(drive, "objects"):
            drive.objects.written = written.append
        on_nmt = drive.on_nmt
        drive.on_nmt = lambda command, go=on_nmt: (reported.append(command), go(command))  # type: ignore[method-assign]
    reasons = on.rig.set_up.prove()
    assert reasons == []
    assert written == []
    on.rig.lockstep.pump()
    assert set(reported) <= {1}


@pytest.mark.parametrize("make", [ROMEO_ARM], ids=lambda make: make.name)
def test_while_tracking_enable_is_refused_and_nothing_is_read(
    on: BreakableArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin(on)
    monkeypatch.setattr(on.rig.boot, "wire", None)  # who would use it fails
    assert "enable" in on.rig.ask(Event.ENABLE)[0]
    assert "reset" in on.rig.ask(Event.RESET)[0]


@pytest.mark.parametrize("make", CANOPEN, ids=lambda make: make.name)
def test_another_product_in_its_place_keeps_the_fault(on: BreakableArm) -> None:
    begin(on)
    fault = goes_wrong(on, another_product)
    (reason,) = on.rig.ask(Event.RESET)
    name = "another product" if on.make is not DURAND else "another drive than at the start"
    assert f"{on.drive.name}" in reason
    assert name in reason
    assert on.make is not DURAND or "restart the daemon after a fault" in reason
    on.run(0.2)
    assert on.rig.mode is Mode.FAULTED
    fault.close()  # type: ignore[attr-defined]
    on.rig.reset()


@pytest.mark.parametrize("make", [ROMEO_ARM, DESK], ids=lambda make: make.name)
def test_messages_of_other_drives_during_a_reset_are_judged_after_it(on: BreakableArm) -> None:
    """An emergency of a healthy drive, and another master's SYNC, come while one is set up."""
    begin(on)
    goes_wrong(on, reboot)
    other = next(drive for drive in on.drives if drive is not on.drive)
    renew = type(on.rig.boot).renew

    def disturbed(boot: object, *args: object) -> None:
        on.say(EMERGENCY + other.node, bytes([0x10, 0x23, 1, 0, 0, 0, 0, 0]))
        on.say(EMERGENCY + on.drive.node, bytes([0x20, 0x82, 1, 0, 0, 0, 0, 0]))
        on.say(SYNC)
        renew(boot, *args)  # type: ignore[arg-type]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(on.rig.boot), "renew", disturbed)
        assert on.rig.ask(Event.RESET) == []
    on.tick()
    reported = [str(finding) for finding in on.rig.last.findings]
    assert any(f"({other.name}): 0x2310 (over-current)" in text for text in reported)
    assert not any("0x8220" in text for text in reported), "that of its lost mapping is over"
    assert Kind.FOREIGN_MASTER in {event.kind for event in on.rig.samples.events}
    assert on.rig.mode is Mode.FAULTED


@pytest.mark.parametrize("make", [ROMEO_ARM, DESK], ids=lambda make: make.name)
def test_a_moving_drive_stops_before_it_is_set_up(on: BreakableArm) -> None:
    """As at a start after a crash, with drives that do not mind the silence."""
    begin(on)
    for drive in on.rig.arm.drives:
        drive.put(0x1016, 1, 0)
    moving = np.abs(on.rig.arm.plant.theta_dot).max()
    assert moving > 0.05
    lines: list[str] = []
    with on.rig.by_sdo():
        on.rig.boot.boot_up(lines.append)
    assert on.speed < 0.02
    assert {drive.state.name for drive in on.rig.arm.drives} == {"QUICK_STOP_ACTIVE"}
    assert sum("was found in operation enabled" in line for line in lines) == len(on.drives)


@pytest.mark.parametrize("make", [ROMEO_ARM], ids=lambda make: make.name)
def test_a_drive_that_does_not_stop_is_not_set_up(on: BreakableArm) -> None:
    begin(on)
    drive = on.simulated
    drive.axis.on_controlword = lambda: None  # type: ignore[method-assign]
    drive.put(0x1016, 1, 0)  # nor does it mind the silence
    before = dict(drive.objects.values)
    with pytest.raises(Exception, match=r"does not stop: 0\.\d+ s after a quick stop it is in "
                       r"operation enabled \(statusword 0x\w+\) and moves at [+-]0\.\d+ rad/s; "
                       "step `standstill`"), on.rig.by_sdo():  # fmt: skip
        on.rig.boot.boot_up()
    changed = {k >> 8 for k, v in drive.objects.values.items() if before[k] != v}
    assert changed <= {0x6040, 0x6041, 0x6064, 0x606C, 0x6077, 0x6078, 0x60E4}
