"""A person who commissions a simulated arm: the steps of `contactd identify`, over the bus and in
lockstep, and a hand at each link when it is asked for."""

import re
import shutil
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, cast, get_args

import msgspec
import yaml

from bench.rigs.arm_batch import SoftHand
from bench.rigs.lockstep import ROMEO
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from common.arrays import Vector
from daemon.config.identified import ENTRIES, IdentifiedJoint
from daemon.config.load import Robot, load_robot
from daemon.config.schema import ArmingStep
from daemon.modes.table import Mode
from estimator.model import Model
from programs.simulate.simulated_robot import describe
from simulator.description import ArmDescription, SimulationSettings
from simulator.hand import Hand
from simulator.mismatch import PlantParameters
from simulator.truth import SimulationFile

Described = Callable[[Robot, SimulationFile], ArmDescription]
"""The simulated arm of a folder, as `lockstep_rig` has it."""
Written = dict[str, Any]  # A config.yaml as plain data.

# Raised a little, so that the shoulder carries something; friction holds it while it is off.
POSE = {"LShoulderPitch": 1.3}
_TOLD = re.compile(r"Set\s+control\.position_gain\s+to\s+(\S+)")
_MASSES = re.compile(r"contactd\s+identify\s+masses")
LONGER = re.compile(r"`--seconds\s+(\d+)`\s+narrows")
_AGAIN = re.compile(r"same\s+command\s+(goes\s+on|begins\s+anew)")
_REPEATS = 4  # of one step, at most
HAND_S = 1.0  # after which the person has read what to do
IDLE_S = 0.01  # between ticks while a step computes


def poor_guesses(written: Written) -> None:
    """Change a configuration to the guesses of a beginner."""
    for joint in written["joints"]:
        joint["half_gap"] = 0.01
        joint["rotor_inertia"] = float(f"{0.5 * joint['rotor_inertia']:.3g}")
        joint["friction"] = {name: 0.5 * value for name, value in joint["friction"].items()}
        peak = joint["torque_constant"] * joint["wiring"]["max_current_A"]
        # So high that nothing stops the arm while its friction is not known.
        joint["thresholds"] = {"contact": 0.45 * peak, "collision": 2.9 * peak}
        joint.pop("known", None)


class OneHand:
    """A person's hand at one link, which leads it softly from beyond one border of its gap to
    beyond the other, and rests there. Stands in the place of `simulator.hand.Hand`."""

    began, touching, done, busy = True, True, False, True

    def __init__(self, served: ServedDaemon, joint: int) -> None:
        arm, robot = served.rig.arm, served.rig.robot
        # The hand finds the gap where it is in truth.
        q = arm.plant.q - arm.plant.phi
        # Masses differ by some per cent, and so does what there is to carry.
        gravity = Model(robot.urdf, robot.configuration.joint_names).gravity(q)
        self._soft = SoftHand([arm.plant.parameters], q, gravity, arm.plant.step_s)
        self._served, self._joint, self._begin_s, self._t = served, joint, 0.0, -1.0

    def update(self, t: float, q: Vector, period_s: float = 0.001) -> list[str]:
        """Once per millisecond."""
        if self._begin_s == 0.0 and self._served.rig.mode is Mode.TRACKING:
            self._begin_s = t + HAND_S  # the program is ready for it
        self._t = t - self._begin_s if self._begin_s else -1.0
        return []

    def torque(self, q: Vector, q_dot: Vector, out: Vector) -> None:
        """Add the hand's torque [Nm] to out (n,)."""
        if self._t > 0.0:
            out[self._joint] += self._soft(self._t, q, q_dot)[self._joint]


class CommissionedArm:
    """An arm to commission: the daemon's folder, that of the arm as it is, and what was found."""

    def __init__(
        self,
        folder: Path,
        model: Path = ROMEO,
        *,
        pose: dict[str, float] | None = None,
        described: Described = describe,
        change: Callable[[Written], None] = poor_guesses,
        really: Callable[[Written], None] = lambda _: None,
        simulate: Callable[[SimulationSettings], SimulationSettings] = lambda s: s,
    ) -> None:
        self.folder, self.truth, self._simulate = folder / "my_arm", folder / "truth", simulate
        self._described = described
        shutil.copytree(ROMEO, folder / "romeo_left_arm")  # others refer to its EDS
        for copy in (self.folder, self.truth):
            shutil.copytree(model, copy, ignore=shutil.ignore_patterns("identified.yaml"))
        for copy, about in ((self.truth, really), (self.folder, change)):
            written = yaml.safe_load((model / "config.yaml").read_text(encoding="utf-8"))
            about(written)
            # As on a robot; here the bus is virtual all the same.
            written["bus"] = {"interface": "socketcan", "channel": "can0", "bitrate": 1_000_000}
            (copy / "config.yaml").write_text(yaml.safe_dump(written), encoding="utf-8")
        if pose:
            path = self.truth / "simulation.yaml"
            simulation = yaml.safe_load(path.read_text(encoding="utf-8"))
            simulation["initial_position"] |= pose
            path.write_text(yaml.safe_dump(simulation), encoding="utf-8")
        self.output, self.lasted_s = "", 0.0
        self.joints = load_robot(self.folder).configuration.joint_names
        self.true: PlantParameters | None = None

    def served(self) -> AbstractContextManager[ServedDaemon]:
        """The daemon started anew, and the arm where it was left hanging."""
        return served_daemon(
            self.folder.parent,
            self.folder,
            truth=self.truth,
            simulate=self._simulate,
            described=self._described,
        )

    def identify(self, *words: str, hand: str = "") -> bool:
        """Type `contactd identify WORDS...` at an arm that holds; `hand` names the link that a
        person moves then. Returns True if all was good."""
        with self.served() as served:
            served.rig.enable()
            self.true = served.rig.arm.plant.parameters
            if hand:
                one = OneHand(served, self.joints.index(hand))
                served.rig.arm.hand = cast(Hand, one)  # all of it that is used
            served.idle_s = IDLE_S
            result = served.contactd("identify", *words, "--yes")
            self.lasted_s = served.rig.time_s
        self.output = result.output
        return result.exit_code == 0

    def set_position_gain(self, gain: float) -> None:
        """Write it into config.yaml."""
        path = self.folder / "config.yaml"
        written = yaml.safe_load(path.read_text(encoding="utf-8"))
        written["control"] = written.get("control", {}) | {"position_gain": gain}
        path.write_text(yaml.safe_dump(written), encoding="utf-8")

    def arming_refusals(self) -> list[str]:
        """Reasons why the arm is not armed; empty if it is."""
        with self.served() as served:
            served.rig.enable()
            served.run(0.5)
            return served.rig.permit()

    def found(self) -> list[IdentifiedJoint]:
        """Entries of each joint in identified.yaml."""
        identified = load_robot(self.folder).identified
        known = identified.joints if identified else {}
        return [known.get(name, IdentifiedJoint()) for name in self.joints]


class Person:
    """A person and the steps that they take, in order; each returns True where it went well."""

    def __init__(
        self,
        folder: Path,
        seed: int,
        show: Callable[[str], None],
        model: Path = ROMEO,
        **about: Any,
    ) -> None:
        """model: folder of the arm; `about` as of `CommissionedArm`."""
        self.show, self._folder, self._seed, self._model = show, folder, seed, model
        self._about = {"pose": POSE} | about
        self.took: dict[str, float] = {}  # Time of each step, of the arm [s]
        self.arm = self.another_arm("an arm")

    def another_arm(self, name: str, **about: Any) -> CommissionedArm:
        """An arm of the same make, with its own folders; `about` as of `CommissionedArm`."""
        more = about.pop("simulate", lambda s: s)
        return CommissionedArm(
            self._folder / name,
            self._model,
            simulate=lambda s: more(msgspec.structs.replace(s, seed=self._seed)),
            **self._about | about,
        )

    def identify(self, arm: CommissionedArm, *words: str, hand: str = "") -> bool:
        """One command, shown with the time that it took."""
        begun = time.monotonic()
        good = arm.identify(*words, hand=hand)
        self.show(f"$ contactd identify {' '.join(words)}")
        self.show(arm.output.rstrip())
        passed = f"{arm.lasted_s:.0f} s of the arm, {time.monotonic() - begun:.0f} s here"
        self.show(f"[{'good' if good else 'not all is good'}, {passed}]\n")
        return good

    def from_zero_to_armed(self) -> dict[str, bool]:
        """All steps, and whether arming was refused before and allowed after them."""
        arm = self.arm
        before = arm.arming_refusals()
        self.show(f"$ contactctl arm\nrefused: {'; '.join(before)}\n")
        went = {"refused before": any("never checked" in reason for reason in before)}
        for step in get_args(ArmingStep):
            if not ENTRIES[step].optional:
                went[step] = self._as_told(step)
            if step == "friction":
                went |= self._as_friction_advises()
        after = arm.arming_refusals()
        self.show(f"$ contactctl arm\n{'refused: ' + '; '.join(after) if after else 'armed'}\n")
        return went | {"armed after": not after}

    def _as_friction_advises(self) -> dict[str, bool]:
        """Masses and friction once more, as far as the output of the friction step advises them."""
        went = {}
        if _MASSES.search(self.arm.output):
            went["masses"] = self._as_told("masses")
            went["friction again"] = self._as_told("friction", name="friction again")
        if advised := LONGER.search(self.arm.output):
            longer = self._as_told("friction", "--seconds", advised[1], name="longer friction")
            went["longer friction"] = longer
        return went

    def _as_told(self, step: str, *words: str, name: str = "") -> bool:
        """One step, repeated with another position gain, or to go on, as often as that is told."""
        arm, name = self.arm, name or step
        for _ in range(_REPEATS):
            good = self.identify(arm, step, *words)
            self.took[name] = round(self.took.get(name, 0.0) + arm.lasted_s, 1)
            if told := _TOLD.search(arm.output):
                arm.set_position_gain(float(told[1]))
            elif not _AGAIN.search(arm.output):
                break
        return good

    def friction_beside(self, name: str, seconds: int, **about: Any) -> CommissionedArm:
        """The friction step on another arm, whose gaps are known from the first."""
        arm = self.another_arm(name, **about)
        shutil.copy(self.arm.folder / "identified.yaml", arm.folder)
        self.identify(arm, "friction", "--seconds", str(seconds))
        return arm
