"""Thresholds from recordings at other levels, and rounded times."""

import shutil
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from bench.rigs.lockstep import SINGLE_JOINT
from daemon.arming.checks import RAISED
from daemon.config.load import Robot, load_robot
from daemon.config.schema import Configuration
from daemon.protocol.state import State
from estimator.transmission import stiction_range
from programs.contactd.contactd import main
from programs.identify.csv_log import COLUMNS, read_csv
from programs.identify.measured import from_states, raised
from programs.identify.step import Outcome
from programs.identify.steps.thresholds import thresholds_outcome

T = 0.01


def with_levels(c: Configuration, *known: str, **changes: float) -> Configuration:
    (joint,) = c.joints
    levels, how = msgspec.structs.replace(joint.thresholds, **changes), dict.fromkeys(known, "so")
    joint = msgspec.structs.replace(joint, thresholds=levels, known=how)
    return msgspec.structs.replace(c, joints=(joint,))


def at_levels(*known: str, **changes: float) -> Robot:
    robot = load_robot(SINGLE_JOINT)
    c = with_levels(robot.configuration, *known, **changes)
    return replace(robot, configuration=c, by_hand=None)


def moved(state: State, seconds: float, c: Configuration, begins_s: float) -> list[State]:
    """Contact-free; with noise in the residual, and a raise that comes and goes."""
    level, rng = c.joints[0].thresholds.contact, np.random.default_rng(round(begins_s))
    return [
        msgspec.structs.replace(
            state,
            time_s=begins_s + T * k,
            mode="tracking",
            current=[0.0],
            link_position=[0.2 * np.sin(T * k)],
            motor_velocity=[0.2 * np.cos(T * k)],
            motor_position=[0.2 * np.sin(T * k)],
            setpoint=[0.2 * np.cos(T * k)],
            residual=[float(r)],
            thresholded=[0.0],
            level_share=None,
            threshold=[level + 0.1 * max(np.sin(T * k), 0.0)],
        )
        for k, r in enumerate(rng.uniform(-0.2, 0.2, round(seconds / T)))
    ]


def test_a_level_is_that_of_its_own_recording(make_state) -> None:
    robot = load_robot(SINGLE_JOINT)
    c, state = robot.configuration, make_state(0)
    higher = with_levels(c, contact=c.joints[0].thresholds.contact + 0.8)

    def learned(*configurations: Configuration) -> float:
        states: list[State] = []
        for k, then in enumerate(configurations):
            states += raised(moved(state, 60.0, then, 100.0 * k), then)
        outcome = thresholds_outcome(robot, from_states(states, ["joint"]), 1.0, "2026-01-02")
        return outcome.entries["joint"].thresholds.contact

    alone = learned(c, c)
    assert learned(c, higher) == learned(higher, c) == learned(higher, higher) == alone
    assert alone > 0.15


def test_what_grew_with_speed_is_no_raise_near_rest(make_state) -> None:
    """A threshold that grew with speed while it was recorded is not learned from."""
    c = load_robot(SINGLE_JOINT).configuration
    growing = with_levels(c, per_speed=0.5)
    states = moved(make_state(0), 60.0, c, 0.0)
    fast = [
        msgspec.structs.replace(s, threshold=[s.threshold[0] + 0.5 * abs(s.motor_velocity[0])])
        for s in states
    ]
    plain, grown = raised(states, c), raised(fast, growing)
    for one, other in zip(plain, grown, strict=True):
        assert other.threshold == pytest.approx(one.threshold, abs=1e-12)


def test_a_level_is_one_that_arm_accepts_at_rest(make_state) -> None:
    """Friction of 7 Nm, of which 0.9 may hide something at rest, beside a residual of 0.2 Nm."""
    robot = at_levels()
    (joint,) = robot.configuration.joints
    rough = msgspec.structs.replace(joint.friction, motor_coulomb=7.0, stiction=0.0)
    c = msgspec.structs.replace(
        robot.configuration, joints=(msgspec.structs.replace(joint, friction=rough),)
    )
    outcome = one_minute(replace(robot, configuration=c), make_state(0))
    most = stiction_range(rough.stiction)[1]
    hidden = (c.estimator.stiction_share + most) * (7.0 + rough.link_coulomb)
    level = outcome.entries["joint"].thresholds.contact
    unsure = c.estimator.unknown_side_share
    raised_to = hidden + (1.0 + unsure) * level
    assert raised_to == pytest.approx(RAISED * level, rel=0.02)
    assert raised_to <= RAISED * level
    (note,) = outcome.notes
    assert note.startswith(f"joint: level raised, as friction hides {hidden:.2g} Nm at rest")


def test_a_joint_that_swings_gets_no_level(make_state) -> None:
    """Through its gap of 0.1 rad at 2.5 Hz, link against motor, not asked for; a reference that
    does it is another matter, and so is what rings at one border."""
    robot = load_robot(SINGLE_JOINT)
    c = robot.configuration

    def verdict(*, asked: bool = False, apart: float = 0.1, gain: float | None = None) -> str:
        states = []
        for s in raised(moved(make_state(0), 60.0, c, 0.0), c):
            w = 2.0 * np.pi * 2.5
            more, faster = 0.05 * np.sin(w * s.time_s), 0.05 * w * np.cos(w * s.time_s)
            states.append(
                msgspec.structs.replace(
                    s,
                    reference=[s.link_position[0] + (more if asked else 0.0)],
                    link_position=[s.link_position[0] + (1.0 - 20.0 * apart) * more],
                    motor_velocity=[s.motor_velocity[0] + faster],
                )
            )
        measured = replace(from_states(states, ["joint"]), gain=gain)
        outcome = thresholds_outcome(robot, measured, 1.0, "2026-01-02")
        (line,) = outcome.lines
        assert bool(outcome.entries) is line.good
        return f"{line.verdict}: {line.reason}"

    assert verdict(asked=True) == "good: "
    assert verdict(apart=0.04) == "good: "
    swings = verdict()
    assert swings.startswith("swings by itself: joint swings by itself at 2.5 Hz, by +-50 mrad")
    assert "control.position_gain to 2 (it was 8)" in swings
    # Measured before the configuration was changed: what is reported follows from the gain of then.
    assert "control.position_gain to 4 (it was 16)" in verdict(gain=16.0)


def test_what_was_discarded_is_reported(make_state) -> None:
    robot = load_robot(SINGLE_JOINT)
    c = robot.configuration
    states = raised(moved(make_state(0), 60.0, c, 0.0), c)
    states[3000] = msgspec.structs.replace(states[3000], thresholded=[0.1])
    outcome = thresholds_outcome(robot, from_states(states, ["joint"]), 1.0, "2026-01-02")
    listed, why, _ = outcome.notes
    assert listed.startswith("joint: discarded ")
    assert " Nm at 30.0 s for 0.0 s" in listed
    assert "contacts were false" in why
    (line,) = outcome.lines
    assert "discarded 1 x, up to " in line.figures
    (kept,) = outcome.entries["joint"].discarded
    assert kept.at_s == pytest.approx(30.0)


def test_what_a_level_has_seen_is_written_with_it(make_state) -> None:
    outcome = one_minute(load_robot(SINGLE_JOINT), make_state(0))
    seen = outcome.entries["joint"].seen
    assert seen.speed == pytest.approx(0.2, rel=0.02)
    assert (seen.lower, seen.upper) == pytest.approx((-0.2, 0.2), rel=0.02)


def test_a_pause_is_no_part_of_rounded_times(tmp_path: Path) -> None:
    times = np.concatenate((0.004 * np.arange(300), 20.0 + 0.004 * np.arange(300)))
    rows = [f"{t:.2f},0,{np.sin(t):.6f},{np.cos(t):.6f}" for t in times]
    path = tmp_path / "log.csv"
    names = [f"{column}.joint" for column in COLUMNS[:3]]
    path.write_text("\n".join([",".join(["time", *names]), *rows]) + "\n")
    log, _ = read_csv(path, ["joint"], {})
    assert log.period_s == pytest.approx(0.004, abs=1e-4)
    np.testing.assert_allclose(log.time_s, times, atol=0.006)
    assert [s.stop - s.start for s in log.stretches(1.0)] == [300, 300]


def one_minute(robot: Robot, state: State) -> Outcome:
    states = raised(moved(state, 60.0, robot.configuration, 0.0), robot.configuration)
    return thresholds_outcome(robot, from_states(states, ["joint"]), 1.0, "2026-01-02")


@pytest.mark.parametrize(("stated", "warns"), [(0.5, False), (0.15, True)])
def test_a_stated_level_is_left(make_state, stated: float, warns: bool) -> None:
    outcome = one_minute(at_levels("thresholds", contact=stated, least=None), make_state(0))
    measured = outcome.entries["joint"].thresholds.contact
    (note,) = outcome.notes
    assert f".contact: {stated:g} Nm is stated in config.yaml and in force; {measured:g} Nm" in note
    assert "remove `thresholds` from its `known`" in note
    assert ("below the measured one" in note) is warns


def test_a_floor_that_does_not_fit_what_was_measured_is_refused(make_state) -> None:
    outcome = one_minute(at_levels(least=0.45), make_state(0))
    (line,) = outcome.lines
    assert (line.verdict, outcome.entries) == ("refused", {})
    assert line.reason.startswith("thresholds.least of config.yaml: 0.45 must be at most ")
    assert outcome.unfinished  # the recording waits for another floor


def swung(seconds: float, seed: int) -> dict[str, np.ndarray]:
    """Single joint that swings in two rhythms, with noise of 0.1 Nm; its model is exact but for
    0.2 Nm that come and go with the position."""
    t, c = T * np.arange(round(seconds / T)), load_robot(SINGLE_JOINT)
    (joint,) = c.configuration.joints
    q = 0.3 * np.sin(0.9 * t + seed) + 0.2 * np.sin(1.7 * t)
    q_dot, q_ddot = np.gradient(q, T), np.gradient(np.gradient(q, T), T)
    gravity = np.array([c.model.gravity(np.array([one]))[0] for one in q])
    f, inertia = joint.friction, c.model.inertia(np.zeros(1))[0] + joint.rotor_inertia
    rubs = (f.motor_coulomb + f.link_coulomb) * np.tanh(q_dot / 0.01)
    rubs += (f.motor_viscous + f.link_viscous) * q_dot
    noise = 0.1 * np.random.default_rng(seed).standard_normal(len(t)) + 0.2 * np.sin(9.0 * q)
    return {
        "time": t,
        "torque.joint": gravity + rubs + inertia * q_ddot + noise,
        "link_position.joint": q,
        "motor_velocity.joint": q_dot,
        "motor_position.joint": q,
    }


def test_levels_of_logs_of_another_program(tmp_path: Path) -> None:
    """Two logs serve as one run of work; the level bears what the model lacks, and no more."""
    folder = shutil.copytree(SINGLE_JOINT.parent, tmp_path / "arms") / SINGLE_JOINT.name
    logs = []
    for seed, seconds in enumerate((25.0, 30.0)):
        columns = swung(seconds, seed)
        logs.append(tmp_path / f"{seed}.csv")
        rows = np.stack(list(columns.values()), axis=1)
        np.savetxt(logs[-1], rows, delimiter=",", header=",".join(columns), comments="")
    asked = ["identify", "thresholds", "--config", str(folder)]
    alone = CliRunner().invoke(main, [*asked, "--log", str(logs[0])])
    assert alone.exit_code == 1
    assert "too little motion" in alone.output
    both = CliRunner().invoke(main, [*asked, *(f"--log={log}" for log in logs)])
    assert both.exit_code == 0, both.output
    found = load_robot(folder).configuration.joints[0].thresholds
    assert 0.3 < found.contact < 3.0
