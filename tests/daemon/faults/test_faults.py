"""Every row of the table of faults, by making that fault: found in time, the right reaction on
the bus, and the way back. The faults are those of `bench.rigs.faults`."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from bench.rigs.breakable_arm import MAKES, BreakableArm, restore, start
from bench.rigs.faults import CASES, EXCLUDED, PLACES, SHOWN, TRIALS, Case, MakeOnWire, Trial
from bench.rigs.lines import LINES
from common.errors import ProgramError
from daemon.faults.conditions import Condition, Response
from daemon.faults.table import TABLE
from daemon.modes.table import Event, Mode
from daemon.shutdown import REPEATS, stop_on_error
from drivers.canopen.ids import EMERGENCY

# A stop command is on the bus so many ticks after the fault was found, at most; where the bus does
# not take frames, after it does again.
PROMPT_TICKS = 2
STANDS = 0.02  # [rad/s], in a quick stop
PROVED_TICKS = 100  # until the stop is proved: the arm swings in its gaps
HOLDS = 0.03  # [rad] in a tenth of a second, of a motor: links may settle in their gaps


def creeps(on: BreakableArm) -> float:
    """Way of a motor in a tenth of a second [rad at the link]."""
    before = on.rig.arm.plant.theta.copy()
    on.run(0.1)
    return float(abs(on.rig.arm.plant.theta - before).max())


def of(reaction: Response) -> list[Trial]:
    return [shown for shown in SHOWN if TABLE[shown.case.condition].response is reaction]


def at(rows: list[Trial]) -> pytest.MarkDecorator:
    """Each row at its place."""
    return pytest.mark.parametrize(
        ("place", "case"), [pytest.param(row.place, row.case, id=str(row)) for row in rows]
    )


on_every_make = pytest.mark.parametrize(
    "place", [place for place in PLACES if place.wire == "virtual"], ids=str
)


def test_every_row_is_made_to_happen() -> None:
    # An error in the program is no finding of a tick: it has tests of its own below. A
    # guardian that goes is in tests/drivers/damiao/test_guardian.py.
    made = {case.condition for case in CASES} | {Condition.PROGRAM_ERROR, Condition.UNGUARDED}
    assert made == set(Condition) == set(TABLE)


def test_an_excluded_case_exists_and_has_its_reason() -> None:
    names = {case.name for case in CASES}
    assert len(names) == len(CASES)
    assert {case for case, _ in EXCLUDED} <= names
    places = {make.name for make in MAKES} | set(LINES)
    assert {where for _, where in EXCLUDED} <= places
    assert len(SHOWN) + sum(bool(row.excluded) for row in TRIALS) == len(TRIALS)
    framed = {row.case.name for row in SHOWN if row.place.wire in ("socketcand", "slcan")}
    assert framed == {case.name for case in CASES if case.frames} - {"network down"}


@pytest.fixture(scope="module")
def stages() -> Iterator[dict[MakeOnWire, BreakableArm]]:
    """The stage at each place, for all that leave it in order."""
    with ExitStack() as stack:
        yield Stages(stack)


class Stages(dict[MakeOnWire, BreakableArm]):
    """Opens what is missing."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack

    def __missing__(self, place: MakeOnWire) -> BreakableArm:
        self[place] = self._stack.enter_context(place.stage())
        return self[place]


@pytest.fixture
def on(stages: dict[MakeOnWire, BreakableArm], place: MakeOnWire) -> Iterator[BreakableArm]:
    """Off, undisturbed and at its first pose; who leaves it in disorder was the last."""
    if (
        place.make.speech.stops_by_ramp
    ):  # its motors hold while the arm is off: it cannot be put back
        with place.stage() as on:
            yield on
        return
    shared = stages.pop(place, None) or stages[place]
    stages.pop(place, None)
    yield shared
    restore(shared)
    stages[place] = shared


@pytest.fixture
def own(place: MakeOnWire) -> Iterator[BreakableArm]:
    """For faults after which contactd must be started again."""
    with place.stage() as on:
        yield on


def reported(on: BreakableArm) -> list[str]:
    return [event.text for event in on.rig.last.notices if event.kind == "fault"]


def happen(on: BreakableArm, case: Case) -> Iterator[None]:
    """Make the fault, tick until it is found, and return it still going on."""
    fault = case.fault(on)
    for _ in range(case.ticks):
        next(fault, None)
        on.tick()
        if case.condition in {finding.condition for finding in on.rig.last.findings}:
            return fault
        cause = on.rig.tick.controller.machine.cause
        sooner = cause.startswith(tuple(condition.value for condition in case.before))
        assert on.rig.mode is not Mode.FAULTED or sooner, cause
    raise AssertionError(f"not found within {case.ticks} ticks")


@at(of(Response.CONTINUE))
def test_a_finding_to_continue_with_leaves_the_arm_tracking(on: BreakableArm, case: Case) -> None:
    start(on, armed=True)
    fault = happen(on, case)
    assert not reported(on)
    reasons = on.rig.arming.run(on.rig.time_s).reasons
    once = case.condition is Condition.LATE  # arming stands one of these
    assert once or any(case.condition.value in reason for reason in reasons)
    for _ in fault:
        on.tick()
    on.run(0.1)
    assert on.rig.mode is Mode.TRACKING
    assert on.rig.tick.controller.machine.armed


@at(of(Response.HOLD))
def test_a_finding_to_hold_for_disarms_and_latches_no_fault(on: BreakableArm, case: Case) -> None:
    start(on, armed=case.armed)
    fault = happen(on, case)
    machine = on.rig.tick.controller.machine
    assert on.rig.mode is Mode.STOPPING
    assert machine.cause.startswith(case.condition.value)
    assert len(reported(on)) == 1
    assert not machine.armed
    before = [abs(velocity) for _, velocity in on.setpoints().values()]
    for _ in range(PROMPT_TICKS):
        next(fault, None)
        on.tick()
        assert len(reported(on)) == 0, "it is reported once"
    after = [abs(velocity) for _, velocity in on.setpoints().values()]
    assert all(b < a or b == 0 for a, b in zip(before, after, strict=True))
    for _ in fault:
        on.tick()
    on.run(0.4)
    assert on.rig.mode is Mode.HOLDING
    assert creeps(on) < HOLDS
    assert on.states == {on.make.speech.operating}
    assert not machine.armed
    # A person may arm it and lead it off, or back; after late ticks, a little later.
    assert all("late" in reason for reason in on.rig.permit("a person"))
    if case.condition is not Condition.JOINT_LIMIT:
        on.rig.request(Event.START)
        on.run(0.05)
        assert on.rig.mode is Mode.TRACKING


def stopped(on: BreakableArm, fault: Iterator[None], case: Case) -> None:
    """The stop command is on the bus in time, the arm comes to rest, and that is proved; or, where
    nothing can say so, silence is left."""
    assert on.rig.mode is Mode.FAULTED
    assert not on.rig.tick.controller.machine.armed
    for _ in range(PROMPT_TICKS + 1):
        while on.mute and next(fault, "over") != "over":
            on.tick()  # nothing can be sent
        if on.stops:
            break
        next(fault, None)
        on.tick()
    assert on.stops
    ramps = on.make.speech.stops_by_ramp  # it has no stop of its own: never silenced, and swings on
    provable = case.provable and (on.drive.profile.sends_motor_position or not case.by_motor)
    provable &= not (ramps and case.by_sdo)
    for _ in range(2 * PROVED_TICKS if ramps else PROVED_TICKS):
        next(fault, None)
        on.tick()
        proved = not on.rig.last.unproved
        alone = on.rig.tick.drives.silenced or ramps
        if on.speed < STANDS and (proved or (alone and not provable)):
            break
    assert on.speed < STANDS
    assert proved is bool(provable)
    assert proved or ramps or on.rig.tick.drives.silenced is not case.obeys


@at(of(Response.QUICK_STOP))
def test_a_fault_stops_all_drives_until_one_reset(on: BreakableArm, case: Case) -> None:
    start(on, armed=case.armed)
    began = on.joints
    fault = happen(on, case)
    assert any(text.startswith(case.condition.value) for text in reported(on))
    stopped(on, fault, case)
    further = abs(on.joints - began) > (on.own_travel if case.own else on.travel)
    assert case.driven or not further.any(), "further than `contactd check` prints"
    getattr(fault, "close", lambda: None)()  # its cause is gone
    on.run(0.5)  # and drives that were left alone have stopped
    controller = on.rig.tick.controller
    for event in (Event.START, Event.ENABLE, Event.DISABLE):
        assert "a fault is latched" in controller.request(event, "a person", on.rig.time_s)[0]
    assert on.rig.permit("a person")
    assert controller.arm("a person")
    on.rig.reset()
    on.until(Mode.HOLDING, Event.ENABLE)
    assert not controller.machine.armed
    decision, samples = on.rig.decision, on.rig.samples
    assert abs(decision.reference - samples.link_position).max() < HOLDS, "it stays where it is"
    assert creeps(on) < HOLDS


@at(of(Response.FAULT_EXIT))
def test_a_fatal_finding_ends_the_program(own: BreakableArm, case: Case) -> None:
    start(own, armed=True)
    assert own.rig.tick.fatal is None
    happen(own, case)
    assert own.rig.tick.fatal is not None
    assert own.rig.tick.fatal.condition is case.condition
    assert own.rig.mode is Mode.FAULTED
    # Nothing reaches the drives any more: they stop by themselves.
    own.alone(1.0)
    assert own.speed < STANDS
    assert own.states == {own.make.after_silence}


class _Broken:
    """Raises on its first call, as a program error would."""

    def __call__(self, *_: object, **__: object) -> None:
        raise ZeroDivisionError("division by zero")


@on_every_make
@pytest.mark.parametrize(
    "where",
    [
        "drives.sync", "drives.collect", "drives.command", "estimator.step", "controller.step",
        "_detector",
    ],
)  # fmt: skip
def test_an_exception_anywhere_in_the_tick_stops_all_drives(
    own: BreakableArm, where: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    on = own
    start(on, armed=True)
    tick = on.rig.tick
    part, _, method = where.partition(".")
    monkeypatch.setattr(getattr(tick, part), method or "findings", _Broken())
    on.wire.sent.clear()
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        on.rig.lockstep.pump()

    with (
        pytest.raises(ProgramError, match="ZeroDivisionError: division by zero") as raised,
        stop_on_error(tick.drives, on.period_s, sleep),
    ):
        on.run(0.1)
    assert raised.value.exit_code == 70
    assert slept == [on.period_s] * REPEATS
    assert on.stops
    assert on.states == {on.make.speech.stopped}
    on.alone(0.3)
    before = on.rig.arm.plant.theta.copy()
    on.alone(0.1)
    assert abs(on.rig.arm.plant.theta - before).max() < HOLDS
    assert "error in the program" in caplog.text
    assert "Traceback" in caplog.text


@on_every_make
def test_stop_on_error_does_nothing_without_an_exception(on: BreakableArm) -> None:
    with stop_on_error(on.rig.drives, on.period_s, sleep=pytest.fail):
        on.tick()


@on_every_make
def test_a_fault_soon_after_a_reset_is_a_fault(on: BreakableArm) -> None:
    """The time that drives have for a fault reset ends when they are enabled."""
    on.make.speech.fail(on)
    on.run(0.05)
    on.until(Mode.OFF, Event.RESET)
    on.until(Mode.HOLDING, Event.ENABLE)
    on.wire.lost.add(EMERGENCY + on.drive.node)
    on.make.speech.fail(on)
    on.run(0.03)
    on.wire.lost.clear()
    assert on.rig.mode is Mode.FAULTED
    cause = on.rig.tick.controller.machine.cause
    assert cause.startswith((Condition.DRIVE_FAULT.value, Condition.EMERGENCY.value))
    assert on.drive.name in cause
    assert on.rig.samples.drives[on.joint].condition.in_fault


@on_every_make
def test_a_drive_still_in_fault_is_not_enabled(on: BreakableArm) -> None:
    on.make.speech.fail(on)
    on.run(0.05)
    on.rig.request(Event.RESET)
    reasons = on.rig.tick.controller.request(Event.ENABLE, "a hasty person", on.rig.time_s)
    assert reasons == [f"drive fault: {on.drive.name}"]


@on_every_make
def test_a_jump_of_the_wall_clock_has_no_effect(on: BreakableArm) -> None:
    start(on, armed=True)
    for wall_s in (1.8e9, 1.8e9 + 3600.0, 0.0, -1.0, 1.8e9):
        on.rig.step(wall_s)
        assert on.rig.state().timing.wall_s == wall_s
        assert on.rig.last.findings == ()
    assert on.rig.mode is Mode.TRACKING
    assert on.rig.tick.controller.machine.armed
