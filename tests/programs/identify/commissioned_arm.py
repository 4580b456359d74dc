"""An arm to commission: the steps of `contactd identify`, over the bus and in lockstep."""

import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import yaml

from bench.rigs.lockstep import ROMEO
from bench.rigs.served_daemon import ServedDaemon, served_daemon
from daemon.config.load import Robot, load_robot
from programs.simulate.simulated_robot import describe
from simulator.description import ArmDescription
from simulator.truth import SimulationFile

Described = Callable[[Robot, SimulationFile], ArmDescription]
"""The simulated arm of a folder, as `lockstep_rig` has it."""
Written = dict[str, Any]  # A config.yaml as plain data.

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
        folder = self.folder
        return served_daemon(folder.parent, folder, truth=self.truth, described=self._described)

    def identify(self, *words: str) -> bool:
        """Type `contactd identify WORDS...` at an arm that holds. Returns True if all was good."""
        with self.served() as served:
            served.rig.enable()
            served.computing_s = IDLE_S
            result = served.contactd("identify", *words, "--yes")
        self.output = result.output
        return result.exit_code == 0

    def arming_refusals(self) -> list[str]:
        """Reasons why the arm is not armed; empty if it is."""
        with self.served() as served:
            served.rig.enable()
            served.run(0.5)
            return served.rig.permit()
