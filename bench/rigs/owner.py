"""Owner of a new arm: from URDF and EDS to an arm that is armed and led, by documented commands.

The owner knows what stands in data sheets, and sees the arm: which way a link goes when it is
pushed, and at which angle it stands. All else is learned from what the commands say. Commands run
as the user's, the daemon and the simulated arm in lockstep.
"""

import io
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
import yaml
from click.testing import CliRunner

from bench.rigs.generated_arms import EDS, PROFILE, URDF, GeneratedArm, in_yaml
from bench.rigs.served_daemon import ServedDaemon, served_daemon, unhurried_drives
from common.errors import ContactdError
from daemon.config.load import load_robot
from daemon.modes.table import Mode
from daemon.service.sensitivity import sensitivity_now
from identification.regression import NORMAL_95
from programs.contactd import contactd
from programs.simulate.simulated_robot import true_arm
from simulator.hand_script import Clamp, Gap, Lean, Release
from simulator.mismatch import true_parameters

OF_DATA_SHEETS = ("node", "gear", "rated_current_A", "max_current_A")
SEEN = 0.01  # as exactly as an angle is read off an arm [rad]
REPORTED = re.compile(r"[Ss]et\s+(control|supervisor)\.(\w+)\s+to\s+(\S+)")
TRIES = 4  # of the wiring: a joint that sags keeps others from being checked
MASSES = "contactd identify masses"
REPEATS = 3  # of a step that says what to change
PRESS, HARDER, SOFTER = 0.01, 3.0, 0.4  # of a hand at a link: a share of the motor's torque
BY_HAND = "identify gap-"  # and a joint: the trajectory in which its motor stands for a hand
IDLE_S = 0.01  # between ticks while a step computes


class GivenUpError(Exception):
    """The owner does not know what to do next; the words are what the last command said."""


@dataclass(slots=True)
class Story:
    """Progress of an owner with one arm."""

    seed: int
    make: str
    joints: int
    hanging: bool
    commands: list[str] = field(default_factory=list)  # as they were typed, one after the other
    seen: list[str] = field(default_factory=list)  # corrected fields of no data sheet
    armed: bool = False
    led: bool = False
    why: str = ""
    machine_s: float = 0.0
    inside: dict[str, list[bool]] = field(default_factory=dict)  # joint by joint, where answered


class Owner:
    """One owner with one arm; `folder` gets what is on the desk, and the configuration."""

    push = 0.5  # of a hand at a link that a brake or the drive holds: a share of its motor's torque
    seen_to_move = 0.002  # [rad]
    carried = False  # the links that are not pushed, as they would hang limp

    def __init__(
        self, arm: GeneratedArm, folder: Path, show: Callable[[str], None] = lambda _: None
    ) -> None:
        self.arm, self.show = arm, show
        self.story = Story(arm.seed, arm.make.name, len(arm.joints), arm.hanging)
        self._desk, self.folder = folder / "desk", folder / "mine"
        self._desk.mkdir(parents=True)
        (self._desk / URDF).write_text(arm.urdf)
        (self._desk / EDS).write_text(arm.make.eds())

    def go(self) -> Story:
        """Everything; where it ends early, the story says why."""
        begin = time.process_time()
        try:
            self.begin()
            with self.running() as served:
                self.zeros(served)
                self._wiring(served)
                self.gaps(served)
                self._identified(served, "friction")
                self._identified(served, "thresholds")
                self._arm_and_lead(served)
            self.story.inside = self._inside()
        except (GivenUpError, ContactdError, AssertionError) as error:
            self.story.why = str(error) or repr(error)
        self.story.machine_s = round(time.process_time() - begin, 1)
        return self.story

    def begin(self) -> None:
        """Draft, fill in what data sheets say, check."""
        eds = f"{PROFILE}={self._desk / EDS}"
        self._typed("new", str(self.folder), "--urdf", str(self._desk / URDF), "--eds", eds)
        # At the other end is this owner's arm, and not the guess that was drafted with it. It was
        # left in a pose in which it carries something.
        pose = np.random.default_rng((self.arm.seed, 24)).uniform(0.2, 0.7, len(self.arm.names))
        truth = self.arm.truth()
        truth["initial_position"] = dict(zip(self.arm.names, pose.tolist(), strict=True))
        (self.folder / "simulation.yaml").write_text(in_yaml(truth))
        self._edit(self._look_up)
        self._typed("check", str(self.folder))

    def _look_up(self, written: dict[str, Any]) -> None:
        """Fill in what data sheets and the wiring list say."""
        drive = written["drives"][PROFILE]
        for name, quantity in self.arm.make.quantities.items():
            if name in drive:
                drive[name] = quantity.entry()
        for joint, sheet in zip(written["joints"], self.arm.joints, strict=True):
            for name in OF_DATA_SHEETS:
                joint["wiring"][name] = sheet["wiring"][name]
            joint["torque_constant"] = sheet["torque_constant"]

    def zeros(self, served: ServedDaemon) -> None:
        """Say where the links stand while the drives are off, push each, and say which way it went:
        signs and zeros of the link encoders."""
        served.run(0.3)
        stood = zip(self.arm.names, served.rig.arm.plant.q.tolist(), strict=True)
        stated = [f"{name}={round(q / SEEN) * SEEN:.2f}" for name, q in stood]
        self.note("contactd identify zero")
        with io.BufferedReader(Pushes(served, self)) as pushes:
            answers = cast(IO[bytes], pushes)
            result = served.contactd("identify", "zero", *stated, answers=answers)
        self.show(result.output)
        if result.exit_code:
            raise GivenUpError(f"zero: {result.output}")

    def _wiring(self, served: ServedDaemon) -> None:
        """Check it, and turn the motors' signs that are said to be wrong, until all is good; what
        is as data sheets say is checked once more."""
        for _ in range(TRIES):
            good, output = self.identify(served, "wiring")
            if good:
                return
            said = " ".join(output.split())
            wrong = [name for name in self.arm.names if f"{name}: the link goes the other" in said]
            if wrong:
                self._edit(partial(self._turn, wrong))
        raise GivenUpError(f"wiring: {output}")

    def _turn(self, names: list[str], written: dict[str, Any]) -> None:
        for joint in written["joints"]:
            if joint["name"] in names:
                joint["wiring"]["motor_sign"] = -joint["wiring"].get("motor_sign", 1)
                self.story.seen.append(f"{joint['name']}.motor_sign")

    def gaps(self, served: ServedDaemon) -> None:
        """Without a hand, and with one at the joints for which it is asked: harder where its step
        says so, else softer."""
        good, output = self.identify(served, "gap")
        names: list[str] = []
        press = PRESS
        for _ in range(REPEATS):
            if good:
                return
            _, found, missed = output.partition("not written: ")
            if found:
                names = missed.splitlines()[0].split(", ")
            if not names:
                break
            good, output = self.identify(served, "gap", *names, "--by-hand", press=press)
            press *= HARDER if "press it" in " ".join(output.split()).lower() else SOFTER
        if not good:
            raise GivenUpError(f"gap: {output}")

    def _identified(self, served: ServedDaemon, step: str) -> None:
        """A step; where it names another gain, or asks for masses, that and the step once more."""
        for _ in range(REPEATS):
            good, output = self.identify(served, step)
            if good:
                return
            reported = REPORTED.search(output)
            if reported:
                self._edit(partial(self._set, reported[1], reported[2], float(reported[3])))
            asked = "identify masses" in output and MASSES not in self.story.commands
            if asked:
                self._identified(served, "masses")
            if not reported and not asked:
                break
        raise GivenUpError(f"{step}: {output}")

    def _set(self, part: str, name: str, value: float, written: dict[str, Any]) -> None:
        written.setdefault(part, {})[name] = value
        self.story.seen.append(f"{part}.{name}")

    def _arm_and_lead(self, served: ServedDaemon) -> None:
        """Arm, lean on the shoulder with twice what `arm` says is felt at rest, and see whether it
        yields."""
        self.control(served, "enable")
        served.run(0.5)
        self.control(served, "arm")
        self.story.armed = True
        rig = served.rig
        felt = sensitivity_now(rig.tick)
        assert felt is not None
        before = float(rig.arm.plant.q[1])
        torque = 2.0 * (felt.resting[1] or 0.0)
        rig.arm.hand.take(Lean(at_s=0.0, joint=felt.joints[1], torque=torque))
        served.run(1.5)
        yields = rig.mode is Mode.ADMITTANCE
        self.story.led = yields and float(rig.arm.plant.q[1]) - before > 0.01
        if not self.story.led:
            raise GivenUpError(f"the hand was not felt: {rig.mode}")

    def _inside(self) -> dict[str, list[bool]]:
        """Whether gap, friction and rotor of each joint lie within the intervals found."""
        robot = load_robot(self.folder)
        description, simulation = true_arm(robot)
        true = true_parameters(description, simulation.settings)
        assert robot.identified is not None
        coulomb, viscous = (of.reshape(2, -1).sum(axis=0) for of in (true.coulomb, true.viscous))
        found: dict[str, list[bool]] = {"gap": [], "K_theta_s": [], "K_theta_v": [], "B": []}
        for i, joint in enumerate(robot.identified.joints[name] for name in self.arm.names):
            if (gap := joint.gap) is not None:
                off = abs(gap.half_gap - true.half_gap[i])
                found["gap"].append(bool(off <= gap.confidence))
            if (entry := joint.friction) is None:
                continue
            its = entry.friction
            by = {
                "K_theta_s": its.motor_coulomb + its.link_coulomb - coulomb[i],
                "K_theta_v": its.motor_viscous + its.link_viscous - viscous[i],
            }
            if entry.rotor_inertia is not None:
                by["B"] = entry.rotor_inertia - true.rotor_inertia[i]
            for name, off in by.items():
                found[name].append(bool(abs(off) <= NORMAL_95 * entry.errors[name]))
        return found

    # -- how commands are typed ------------------------------------------------------------------

    @contextmanager
    def running(self) -> Iterator[ServedDaemon]:
        """The daemon started anew."""
        self.note("contactd run")
        with (
            unhurried_drives(),
            served_daemon(
                self.folder.parent, self.folder, described=lambda robot, _: true_arm(robot)[0]
            ) as served,
        ):
            yield served

    def note(self, command: str) -> None:
        """Count a command that is typed."""
        self.show(f"$ {command}")
        self.story.commands.append(command)

    def _typed(self, *words: str) -> None:
        self.note(f"contactd {words[0]}")
        result = CliRunner().invoke(contactd.main, list(words))
        self.show(result.output)
        if result.exit_code:
            raise GivenUpError(f"contactd {words[0]}: {result.output}")

    def _edit(self, change: Callable[[dict[str, Any]], None]) -> None:
        path = self.folder / "config.yaml"
        written = yaml.safe_load(path.read_text())
        change(written)
        path.write_text(in_yaml(written))

    def control(self, served: ServedDaemon, *words: str) -> None:
        """`contactctl WORDS`; raises GivenUpError where it is refused."""
        command = " ".join(words)
        self.note(f"contactctl {command}")
        result = served.contactctl(*words)
        if result.exit_code:
            raise GivenUpError(f"contactctl {command}: {result.output}")

    def identify(self, served: ServedDaemon, *words: str, press: float = 0.0) -> tuple[bool, str]:
        """`contactd identify WORDS`: whether all was good, and what it said; a hand at the link
        that is asked for presses with a share of its motor's torque."""
        self.note(f"contactd identify {' '.join(words)}")
        over = threading.Event()
        hand = threading.Thread(target=self._hand, args=(served, press, over))
        if press:
            hand.start()
        served.computing_s = IDLE_S
        result = served.contactd("identify", *words, "--yes")
        over.set()
        if press:
            hand.join()
        self.show(result.output)
        return result.exit_code == 0, result.output

    def _hand(self, served: ServedDaemon, press: float, over: threading.Event) -> None:
        """A hand at one link after the other, each once the step is ready for it."""
        at = ""
        while not over.wait(0.01):
            rig = served.rig
            ready = rig.mode is Mode.TRACKING
            name = rig.tick.controller.motion.follower.place.path.name if ready else ""
            if name == at:
                continue
            rig.arm.hand.take(Release(at_s=0.0))
            at = name
            joints = {f"{BY_HAND}{j.name}": j for j in rig.robot.configuration.joints}
            if joint := joints.get(name):
                torque = press * joint.torque_constant * joint.wiring.max_current_A
                rig.arm.hand.take(Gap(at_s=0.0, joint=joint.name, torque=torque, times=200))
        served.rig.arm.hand.take(Release(at_s=0.0))


class Pushes(io.RawIOBase):
    """Answers of a person who is asked which way a link went, joint by joint: pushes it first."""

    def __init__(self, served: ServedDaemon, owner: Owner) -> None:
        self._rig, self._owner = served.rig, owner
        self._joints = iter(enumerate(owner.arm.joints))

    def close(self) -> None:
        """Let go."""
        self._rig.arm.hand.take(Release(at_s=0.0))
        super().close()

    def readable(self) -> bool:
        """True."""
        return True

    def readinto(self, into: Any) -> int:
        """Push the next link for a second, the other way, or harder, if it hardly moves."""
        i, joint = next(self._joints)
        hand, plant = self._rig.arm.hand, self._rig.arm.plant
        stood = float(plant.q[i])
        torque = self._owner.push * joint["torque_constant"] * joint["wiring"]["max_current_A"]
        for way in (1.0, -1.0, 2.0, -2.0):
            hand.take(Release(at_s=0.0))
            if self._owner.carried:
                others = tuple(name for name in self._owner.arm.names if name != joint["name"])
                hand.take(Clamp(at_s=0.0, joints=others))
            hand.take(Lean(at_s=0.0, joint=joint["name"], torque=way * torque))
            self._let_pass(1.0)
            went = float(plant.q[i]) - stood
            if abs(went) > self._owner.seen_to_move:
                break
        into[:2] = b"+\n" if went > 0.0 else b"-\n"
        return 2

    def _let_pass(self, seconds: float) -> None:
        until = self._rig.time_s + seconds
        while self._rig.time_s < until:
            time.sleep(0.001)
