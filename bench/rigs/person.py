"""An arm to commission: the steps of `contactd identify`, over the bus and in lockstep, and a hand
at each link when it is asked for."""

import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, cast

import yaml

from bench.rigs.arm_batch import SoftHand
from bench.rigs.lockstep import ROMEO
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from common.arrays import Vector
from daemon.config.load import Robot, load_robot
from daemon.modes.table import Mode
from estimator.model import Model
from programs.simulate.simulated_robot import describe
from simulator.description import ArmDescription
from simulator.hand import Hand
from simulator.truth import SimulationFile

Described = Callable[[Robot, SimulationFile], ArmDescription]
"""The simulated arm of a folder, as `lockstep_rig` has it."""
Written = dict[str, Any]  # A config.yaml as plain data.

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
        model: Path,
        *,
        described: Described = describe,
        change: Callable[[Written], None] = poor_guesses,
        really: Callable[[Written], None] = lambda _: None,
    ) -> None:
        self.folder, self.truth = folder / "my_arm", folder / "truth"
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
        self.output = ""
        self.joints = load_robot(self.folder).configuration.joint_names

    def served(self) -> AbstractContextManager[ServedDaemon]:
        """The daemon started anew, and the arm where it was left hanging."""
        return served_daemon(
            self.folder.parent,
            self.folder,
            truth=self.truth,
            described=self._described,
        )

    def identify(self, *words: str, hand: str = "") -> bool:
        """Type `contactd identify WORDS...` at an arm that holds; `hand` names the link that a
        person moves then. Returns True if all was good."""
        with self.served() as served:
            served.rig.enable()
            if hand:
                one = OneHand(served, self.joints.index(hand))
                served.rig.arm.hand = cast(Hand, one)  # all of it that is used
            served.idle_s = IDLE_S
            result = served.contactd("identify", *words, "--yes")
        self.output = result.output
        return result.exit_code == 0

    def arming_refusals(self) -> list[str]:
        """Reasons why the arm is not armed; empty if it is."""
        with self.served() as served:
            served.rig.enable()
            served.run(0.5)
            return served.rig.permit()
