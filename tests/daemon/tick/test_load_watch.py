"""Unannounced loads in the whole program: reported, held, never learned, and announced at last."""

from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import ROMEO, Rig, lockstep_rig
from bench.rigs.recorded_arm import LockstepClient
from daemon.config.schema import Configuration, Sinusoid
from daemon.modes.table import Event, Mode
from daemon.protocol.state import State
from daemon.tick.load_watch import Interruptions
from estimator.payload import Payload
from programs.clients.log_reader import read_log
from programs.clients.recorder import record
from programs.clients.replay import replay

SWING = {
    "LShoulderPitch": Sinusoid(amplitude=0.35, frequency_Hz=0.15),
    "LElbowRoll": Sinusoid(amplitude=0.6, frequency_Hz=0.12),
    "LWristRoll": Sinusoid(amplitude=0.6, frequency_Hz=0.1),
    "LWristPitch": Sinusoid(amplitude=0.3, frequency_Hz=0.17),
}
CUP = Payload.of(0.5, [0.07, 0.0, 0.0])
JUG = Payload.of(1.0, [0.07, 0.0, 0.0])


def swinging(c: Configuration) -> Configuration:
    trajectory = msgspec.structs.replace(c.trajectory, sinusoids=SWING)
    return msgspec.structs.replace(c, trajectory=trajectory)


@pytest.fixture
def rig() -> Iterator[Rig]:
    with lockstep_rig(ROMEO, configure=swinging) as opened:
        opened.enable()
        opened.request(Event.START)
        opened.run(10.0)
        yield opened


def give(rig: Rig, payload: Payload | None) -> None:
    rig.arm.plant.carry(payload.mass if payload else 0.0, np.array(CUP.com))


def arm_and_give(rig: Rig, payload: Payload | None = None) -> None:
    """Arm the arm at work; then put the load into the hand."""
    rig.run(20.0)
    assert not rig.permit()
    if payload is not None:
        give(rig, payload)


def until_it_yields(rig: Rig, found: Payload | None = None) -> None:
    """Run until the load leads the arm; `found`: load recognised in each tick, not confirmed."""
    for _ in range(1000):
        if found is not None:
            rig.tick.loads._recognition.found = found
        rig.step()
        if rig.mode is Mode.ADMITTANCE and rig.estimate.thresholded.any():
            return
    pytest.fail(f"in {rig.mode}")


def friction(rig: Rig) -> list[list[float]]:
    """Learned friction of each joint."""
    return [shares[1:] for shares in rig.tick.estimator.memory()["learning"]["shares"]]


def news(rig: Rig, seconds: float) -> list[str]:
    found: list[str] = []
    rig.run(seconds, lambda: found.extend(n.text for n in rig.last.notices if n.kind == "mode"))
    return found


def believe(rig: Rig, payload: Payload) -> None:
    """Set the load as recognised and confirmed in this tick."""
    rig.tick.loads._recognition.found = payload
    rig.tick.loads._recognition.confirmed = True


def test_an_unannounced_load_is_reported_and_not_learned(rig: Rig, tmp_path: Path) -> None:
    rig.run(20.0)
    give(rig, CUP)
    said: list[str] = []

    def stop() -> bool:
        said.extend(n.text for n in rig.last.notices if n.kind == "mode")
        return rig.ticks >= 4700

    path = tmp_path / "cup.mcap"
    record(lambda: LockstepClient(rig), path, stop=stop)  # type: ignore[arg-type, return-value]
    loads = [text for text in said if "looks like a load" in text]
    assert len(loads) == 1
    assert "kg at the hand: `contactctl payload 0." in loads[0]
    found = rig.last.recognised
    assert found is not None
    assert found.mass == pytest.approx(CUP.mass, rel=0.15)
    assert rig.mode is Mode.TRACKING  # not armed
    assert rig.last.payload is None  # the model is as it was
    learning = friction(rig)
    level = rig.tick.estimator.detector.levels.contact_at(0, 0.0)
    rig.run(5.0)
    assert friction(rig) == learning
    assert rig.tick.estimator.detector.levels.contact_at(0, 0.0) == level
    # It replays with what was recognised in the middle of it.
    assert replay(path).identical
    seen = {m.recognised is None for m in read_log(path) if isinstance(m, State)}
    assert seen == {True, False}
    # Announced: it is no load any more, and learning goes on.
    assert not rig.tick.carry(found, "the test")
    assert rig.tick.loads.found is None
    said = news(rig, 10.0)
    assert rig.tick.loads.found is None
    assert friction(rig) != learning
    assert not [text for text in said if "looks like" in text]


def test_an_armed_arm_holds_what_it_carries_and_yields_to_a_change(rig: Rig) -> None:
    arm_and_give(rig, CUP)
    believe(rig, CUP)
    said = news(rig, 8.0)
    assert rig.mode is Mode.HOLDING
    assert any("-> stopping: " in text and "looks like a load of 0.5 kg" in text for text in said)
    assert not any("admittance" in text for text in said)
    assert rig.tick.controller.machine.armed
    # Held, however long; and not started again before it is announced.
    rig.run(3.0)
    assert rig.mode is Mode.HOLDING
    if rig.estimate.thresholded.any():
        (reason,) = rig.tick.controller.refusals(Event.START)
        assert "looks like a load of 0.5 kg at the hand, announce it first" in reason
    # A hand beside it, in either direction, is a hand.
    rig.arm.external_torque[0] = -6.0
    rig.run(0.5)
    assert rig.mode is Mode.ADMITTANCE
    rig.arm.external_torque[0] = 0.0
    rig.run(1.0)
    rig.tick.controller.request(Event.STOP, "the test", rig.time_s)


def test_a_load_confirmed_while_it_leads_the_arm_is_held(rig: Rig) -> None:
    arm_and_give(rig, JUG)
    until_it_yields(rig)
    rig.run(0.05)  # the residual shows it
    believe(rig, JUG)
    rig.step()
    assert rig.mode is Mode.STOPPING
    rig.run(1.0)
    assert rig.mode is Mode.HOLDING
    assert rig.tick.controller.machine.paused
    assert not rig.tick.carry(JUG, "the test")
    rig.run(0.5)
    rig.request(Event.START)
    said = news(rig, 15.0)
    assert rig.mode is Mode.TRACKING, said


def test_a_recognised_load_that_is_not_confirmed_leads_the_arm_on(rig: Rig) -> None:
    """It is reported with advice; in doubt it is a person."""
    arm_and_give(rig, JUG)
    until_it_yields(rig, JUG)
    assert rig.tick.loads.words == "looks like a load of 1 kg at the hand"
    assert rig.tick.loads.advice.startswith("`contactctl stop`, then `contactctl payload 1")
    for _ in range(100):
        rig.tick.loads._recognition.found = JUG
        rig.step()
        assert rig.mode is Mode.ADMITTANCE


def test_the_arm_stays_when_a_person_taken_for_a_load_lets_go(rig: Rig) -> None:
    """A pull of constant force, straight down, is a load to the residual. The arm holds; it does
    not go on by itself when the hand is gone, and yields to the next touch."""
    arm_and_give(rig, JUG)
    rig.run(0.1)
    for _ in range(1000):
        if rig.mode is Mode.HOLDING:
            break
        believe(rig, JUG)
        rig.step()
    assert rig.mode is Mode.HOLDING
    q = rig.samples.link_position.copy()
    level = rig.tick.estimator.detector.levels.contact_at(0, 0.0)
    give(rig, None)
    said = news(rig, 6.0)
    assert rig.mode is Mode.HOLDING, said
    assert rig.last.payload is None
    stated = rig.robot.configuration.joints[0].thresholds.contact  # it stands, and is in doubt
    assert 0.95 * level < rig.tick.estimator.detector.levels.contact_at(0, 0.0) <= stated
    np.testing.assert_allclose(rig.samples.link_position, q, atol=0.03)  # links fall through gaps
    rig.arm.external_torque[3] = 2.5
    rig.run(0.5)
    assert rig.mode is Mode.ADMITTANCE
    rig.run(0.6)
    assert rig.tick.loads.found is None
    rig.arm.external_torque[3] = 0.0


def test_a_load_is_reported_again_when_its_mass_changes(rig: Rig) -> None:
    give(rig, CUP)
    believe(rig, CUP)
    believed = msgspec.structs.replace(CUP, mass=0.55)
    assert not [text for text in news(rig, 0.1) if "looks like" in text]
    rig.tick.loads._reported_kg = CUP.mass
    before = rig.tick.loads.found
    for found, said in ((believed, 0), (JUG, 1)):
        rig.tick.loads._recognition.found = found
        texts = [notice.text for notice in rig.tick.loads._news(before, often=False)]
        assert len(texts) == said
        before = found
    assert texts[0].startswith("looks like a load of 1 kg")


def test_a_load_is_forgotten_when_the_drives_are_off(rig: Rig) -> None:
    give(rig, CUP)
    believe(rig, CUP)
    rig.run(0.1)
    assert rig.last.recognised is not None
    rig.request(Event.DISABLE)
    rig.run(3.0)
    assert rig.mode is Mode.OFF
    assert rig.last.recognised is None


def test_a_load_beside_an_announced_one_is_advised_as_their_sum(rig: Rig) -> None:
    """Water in the cup: both together are what is to be announced."""
    assert not rig.tick.carry(CUP, "the test")
    loads = rig.tick.loads
    believe(rig, Payload.of(0.25, [0.10, 0.0, -0.03]))
    assert loads.words == "looks like 0.25 kg more at the hand than the 0.5 kg announced"
    assert loads.advice == "`contactctl payload 0.75 --com 0.08 0.00 -0.01`"
    assert not rig.tick.carry(None, "the test")
    believe(rig, Payload.of(0.25, [0.10, -0.001, -0.03]))
    assert loads.words == "looks like a load of 0.25 kg at the hand"
    assert loads.advice == "`contactctl payload 0.25 --com 0.10 0.00 -0.03`"


def until_it_holds(rig: Rig) -> None:
    for _ in range(1000):
        believe(rig, JUG)
        rig.step()
        if rig.mode is Mode.HOLDING and rig.estimate.thresholded.any():
            break
    assert rig.mode is Mode.HOLDING


@pytest.mark.parametrize("torque", [2.5, -2.5])
def test_a_hand_is_detected_while_an_announced_load_settles(rig: Rig, torque: float) -> None:
    """The load that the residual still shows for some 0.1 s covers no touch of a joint."""
    arm_and_give(rig, JUG)
    until_it_holds(rig)
    assert not rig.tick.carry(JUG, "the test")
    rig.arm.external_torque[3] = torque
    rig.run(0.1)
    assert rig.mode is Mode.ADMITTANCE
    assert np.sign(rig.estimate.thresholded[3]) == np.sign(torque)


def test_an_announced_load_that_is_absent_is_a_contact(rig: Rig) -> None:
    """Its weight is felt upwards, at once: nothing of it is taken for what settles."""
    arm_and_give(rig)
    assert not rig.tick.carry(JUG, "the test")
    rig.run(0.15)
    assert rig.mode is Mode.ADMITTANCE


def test_an_arm_that_holds_a_load_is_reported_and_does_not_move(rig: Rig) -> None:
    """Armed, at rest against more than the level: what is left of it in r is no hand's."""
    arm_and_give(rig, JUG)
    believe(rig, JUG)
    until_it_holds(rig)
    q = rig.samples.link_position.copy()
    assert not rig.tick.carry(JUG, "the test")
    assert not rig.tick.controller.refusals(Event.START)
    said = news(rig, 1.0)
    assert rig.mode is Mode.HOLDING, said
    assert not rig.estimate.thresholded.any()
    np.testing.assert_allclose(rig.samples.link_position, q, atol=2e-3)
    rig.request(Event.START)
    said = news(rig, 10.0)
    assert rig.mode is Mode.TRACKING, said


@pytest.mark.parametrize(
    ("load", "seconds", "words"),
    [
        (JUG, 5.0, "something pulls straight down at the hand, like some 1.4 kg: if it is a load,"),
        (CUP, 15.0, "looks like a load of 0.4"),  # it interrupts less than three times
    ],
    ids=["jug", "cup"],
)
def test_an_armed_arm_that_yields_to_a_load_reports_advice_within_seconds(
    rig: Rig, load: Payload, seconds: float, words: str
) -> None:
    """It stands at rest, where friction makes more or less of the load. It is reported, armed,
    started, and goes on."""
    arm_and_give(rig, load)
    said, *_ = [text for text in news(rig, seconds) if "contactctl payload" in text]
    assert said.startswith(words)
    if load is JUG:
        assert said.endswith("`contactctl stop`, then `contactctl payload MASS` with its mass")
    if rig.mode is Mode.ADMITTANCE:
        assert rig.tick.carry(load, "the test")  # refused
    rig.request(Event.STOP)
    rig.run(1.0)
    assert rig.mode is Mode.HOLDING
    assert not rig.tick.carry(load, "the test")
    assert not rig.tick.loads.hint
    rig.run(0.3)
    assert not rig.permit()
    rig.request(Event.START)
    if load is CUP:  # where the jug hangs now, the wrist's motor does not hold it
        said_later = news(rig, 10.0)
        assert rig.mode is Mode.TRACKING, said_later


def test_a_hand_that_leads_is_no_hint(rig: Rig) -> None:
    arm_and_give(rig)
    rig.arm.external_torque[3] = 2.5
    said = news(rig, 4.0)
    assert rig.mode is Mode.ADMITTANCE
    assert not [text for text in said if "if it is a load" in text]
    assert not rig.tick.loads.hint
    rig.arm.external_torque[3] = 0.0


def test_more_than_an_announced_load_is_hinted_with_both(rig: Rig) -> None:
    assert not rig.tick.carry(CUP, "the test")
    loads = rig.tick.loads
    loads._pull.mass = 0.3
    words = "like some 0.3 kg more than the 0.5 kg announced: if it is a load, `contactctl p"
    assert words in loads.hint
    believe(rig, CUP)  # recognised: that is reported instead
    assert not loads.hint


@pytest.mark.parametrize("goes_on", [Mode.TRACKING, Mode.RETURNING])
@pytest.mark.parametrize(
    ("every", "often"), [(300, True), (600, True), (601, False), (2000, False)]
)
def test_a_trajectory_is_often_interrupted(goes_on: Mode, every: int, often: bool) -> None:
    """Every so many ticks of 10 ms; for as long as it lasts, and no longer."""
    seen, modes = Interruptions(0.01), [goes_on, Mode.ADMITTANCE]
    for _ in range(2):
        seen.step(modes[0], modes[1])
        for _ in range(every - 2):
            seen.step(modes[1], modes[1])
            assert not seen.often
        seen.step(modes[1], modes[0])
    seen.step(modes[0], modes[1])
    assert seen.often is often
    for _ in range(1199):
        seen.step(modes[1], modes[1])
    assert seen.often is often
    seen.step(modes[1], modes[1])
    assert not seen.often


def test_interruptions_are_reported_once_and_forgotten_with_an_announced_load(rig: Rig) -> None:
    rig.run(1.0)
    assert not rig.permit()
    said: list[str] = []
    for _ in range(3):
        rig.arm.external_torque[3] = 2.5
        said += news(rig, 0.5)
        assert rig.mode is Mode.ADMITTANCE
        rig.arm.external_torque[3] = 0.0
        said += news(rig, 3.0)
    often = [text for text in said if "interrupted the trajectory" in text]
    assert often == [
        "contacts interrupted the trajectory 3 times in 12 s: if the hand carries a load, "
        "`contactctl stop`, then `contactctl payload MASS` with its mass"
    ]
    assert "`contactctl payload MASS`" in rig.tick.loads.hint
    assert not rig.tick.carry(None, "the test")
    assert not rig.tick.loads.hint
