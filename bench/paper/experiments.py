"""The paper's experiments on the simulated arm, each a `Recording`."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import cycle
from typing import Literal

import msgspec

from bench.rigs.lockstep import ROMEO, SINGLE_JOINT, Rig, lockstep_rig
from bench.study.estimates import VARIANTS
from bench.study.recording import Recorder, Recording
from bench.study.rivals import KALMAN, KALMAN_BELIEF, kalman
from daemon.config.load import load_robot
from daemon.config.schema import Configuration, Joint, Sinusoid, Trajectory
from daemon.modes.table import Event, Mode
from daemon.protocol.state import State
from daemon.service.status import context_of
from programs.demo.demo_story import RunFigures, touch_of
from simulator.description import Mismatch, SimulationSettings
from simulator.events import SimulationEvent
from simulator.hand_script import Push, read_script

BESIDE = tuple(variant for variant in VARIANTS if not variant.name.startswith("backlash"))

FIRST_JOINT = {"LShoulderPitch": Sinusoid(amplitude=0.35, frequency_Hz=0.15)}
# Joints 1, 3, 4 and 7, as the paper moves them in its second experiment.
FOUR_JOINTS = {
    "LShoulderPitch": Sinusoid(amplitude=0.35, frequency_Hz=0.15),
    "LElbowRoll": Sinusoid(amplitude=0.5, frequency_Hz=0.12),
    "LElbowYaw": Sinusoid(amplitude=0.3, frequency_Hz=0.2),
    "LWristPitch": Sinusoid(amplitude=0.4, frequency_Hz=0.25),
}
REST_S = 20.0
HAND_AHEAD_S = 1.4  # the hand's clock begins while the drives are being enabled
WORKED_S = 240.0  # before the contacts the arm has been at work for so long
SETTLE_S = 1.0  # after the drives are enabled, before anything is recorded


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions of the plant: the default mismatch, and a motor velocity that is a little off."""

    seed: int = 1
    friction: Literal["smooth", "dahl"] = "smooth"
    exact: bool = False  # the plant is what the model believes, and nothing is noisy

    def __call__(self, settings: SimulationSettings) -> SimulationSettings:
        settings = msgspec.structs.replace(settings, seed=self.seed, friction=self.friction)
        if self.exact:
            same = Mismatch(**dict.fromkeys(Mismatch.__struct_fields__, 0.0))
            return msgspec.structs.replace(
                settings, mismatch=same, velocity_noise=0.0, current_noise_permille=0.0
            )
        return msgspec.structs.replace(settings, velocity_scale_error=0.002, velocity_bias=0.001)


def with_rivals(waves: Mapping[str, Sinusoid] | None = None) -> Callable[..., Configuration]:
    """A change of the configuration: all residuals run; `waves`, if any, are the trajectory.

    Theta is integrated from the motor velocity, as in the paper.
    """

    def change(c: Configuration) -> Configuration:
        estimator = msgspec.structs.replace(c.estimator, beside=BESIDE, motor_position="integrated")
        trajectory = c.trajectory if waves is None else Trajectory(sinusoids=dict(waves))
        return msgspec.structs.replace(c, estimator=estimator, trajectory=trajectory)

    return change


def with_kalman(recording: Recording) -> Recording:
    """Recording with the Kalman observer beside the residuals, from the same samples."""
    c = recording.configuration
    values = kalman(recording.residuals[KALMAN_BELIEF], c.estimator.gain, c.period_s)
    return replace(recording, residuals=recording.residuals | {KALMAN: values})


def single_joint(conditions: Conditions, seconds: float = 20.0) -> Recording:
    """Fig. 2: one joint with a gap of 0.1 rad in its sinusoid, without contact."""
    with lockstep_rig(SINGLE_JOINT, configure=with_rivals(), simulate=conditions) as rig:
        return _record(rig, seconds)


def contact_free(conditions: Conditions) -> Recording:
    """Fig. 8: the first joint in its sinusoid, all others hold, without contact."""
    with lockstep_rig(configure=with_rivals(FIRST_JOINT), simulate=conditions) as rig:
        return _record(rig, 30.0)


def contacts(conditions: Conditions) -> Recording:
    """Figs. 9 and 11: at rest for 20 s, then joints 1, 3, 4 and 7 in sinusoids; a hand pushes. An
    arm that has been at work before."""
    configure = with_rivals(FOUR_JOINTS)
    robot = load_robot(ROMEO).configuration
    with lockstep_rig(configure=configure, simulate=conditions, hand=pushes(robot)) as rig:
        rig.enable()
        rig.run(SETTLE_S)
        rig.request(Event.START)
        rig.run(WORKED_S - 3.0)
        rig.request(Event.PAUSE)
        rig.run(3.0)
        recorder = Recorder(rig)
        rig.run(REST_S, recorder)
        rig.request(Event.START)
        rig.run(44.0, recorder)
        return _finished(rig, recorder)


def pushes(c: Configuration) -> tuple[Push, ...]:
    """One push at a time: each of the four joints both ways at rest, then twice that in motion.

    Half sines of 0.9 s. At rest they are a quarter stronger than the least that can be promised,
    where stiction holds back half of itself. In motion at twice the threshold and at four times,
    or at three quarters of what the motor can hold: beyond that the daemon stops the arm.
    """
    joints = [joint for joint in c.joints if joint.name in FOUR_JOINTS]
    script = []
    at_s = HAND_AHEAD_S + WORKED_S + 1.5
    for sign in (1.0, -1.0):
        for joint in joints:
            script.append(_push(joint, at_s, sign * 1.25 * least_at_rest(joint)))
            at_s += 2.3
    at_s = HAND_AHEAD_S + WORKED_S + REST_S + 4.0
    for strong, sign in zip((False, True, True, False), cycle((-1.0, 1.0)), strict=False):
        for joint in joints:
            contact = joint.thresholds.contact
            held = 0.75 * joint.wiring.max_current_A * joint.torque_constant
            torque = min(4.0 * contact, held) if strong else 2.0 * contact
            script.append(_push(joint, at_s, sign * torque))
            at_s += 2.3
    return tuple(script)


def least_at_rest(joint: Joint) -> float:
    """Least torque [Nm] to be detected at rest: twice the threshold, beyond half the stiction."""
    stuck = joint.friction.motor_coulomb + joint.friction.link_coulomb
    contact = joint.thresholds.contact
    return max(2.0 * contact, contact + 0.5 * stuck)


def collaboration(conditions: Conditions) -> tuple[Recording, RunFigures]:
    """Fig. 13: the first joint in its sinusoid; a hand pushes, guides the arm and lets go."""
    happenings: list[SimulationEvent] = []
    hand = read_script(ROMEO / "third_experiment.yaml")
    with lockstep_rig(
        configure=with_rivals(), simulate=conditions, hand=hand, on_event=happenings.append
    ) as rig:
        rig.enable()
        rig.run(SETTLE_S)
        refused = rig.permit("the bench")
        assert not refused, refused
        rig.request(Event.START)
        begin_s, recorder, states = rig.time_s, Recorder(rig), []

        def each() -> None:
            recorder()
            states.append(_clocked(rig.state(), begin_s))

        rig.run(24.0, each)
        ahead_s = rig.time_s - rig.arm.now - begin_s
    lines = [{"monotonic_s": h.at_s + ahead_s, "kind": h.kind, "text": h.text} for h in happenings]
    recording = with_kalman(recorder.recording())
    return recording, RunFigures(
        recording.configuration, context_of(rig.robot), states, touch_of(lines, hand)
    )


def _clocked(state: State, begin_s: float) -> State:
    """Recorder that also sets the time."""
    time_s = state.time_s - begin_s
    timing = msgspec.structs.replace(state.timing, monotonic_s=time_s)
    return msgspec.structs.replace(state, time_s=time_s, timing=timing)


def _push(joint: Joint, at_s: float, torque: float) -> Push:
    return Push(at_s=at_s, joint=joint.name, torque=torque, duration_s=0.9, shape="pulse")


def _record(rig: Rig, seconds: float) -> Recording:
    rig.enable()
    rig.run(SETTLE_S)
    rig.request(Event.START)
    recorder = Recorder(rig)
    rig.run(seconds, recorder)
    return _finished(rig, recorder)


def _finished(rig: Rig, recorder: Recorder) -> Recording:
    """The recording with the rival. A fault on the way would have spoilt the figure."""
    assert rig.mode is Mode.TRACKING, (rig.mode, rig.tick.controller.machine.cause)
    return with_kalman(recorder.recording())
