"""Mistakes that `contactd check` does not refuse, taken to the arm: what the program still permits
there, in lockstep.

The owner ignores the check: starts the daemon, enables, tries to arm and to start a trajectory, and
checks the wiring of the joint, whose short motion is the only one permitted.
"""

from dataclasses import dataclass
from pathlib import Path

import yaml

from bench.rigs.generated_arms import GeneratedArm, in_yaml
from bench.rigs.served_daemon import served_daemon
from bench.study.mistakes import JOINT, Mistake, reported
from common.errors import ContactdError
from daemon.config.load import load_robot
from daemon.modes.table import Mode
from programs.simulate.simulated_robot import true_arm

TRUE_URDF = "simulation.urdf"
POSE = 0.3  # of every joint [rad], so that it carries something


@dataclass(frozen=True, slots=True)
class Met:
    """Outcome of a mistake at the arm. `ended` is empty if it got as far as the wiring check."""

    words: str
    reported: bool
    refused: bool = False
    ended: str = ""
    armed: bool = False
    ran: bool = False  # a trajectory other than that of the wiring check
    wiring_good: bool = False

    @property
    def harmful(self) -> bool:
        """True if the arm was armed or ran, or nothing prevents the owner from doing so."""
        return self.armed or self.ran or (self.wiring_good and not self.reported)


def met(mistake: Mistake, arm: GeneratedArm, folder: Path) -> Met:
    """Outcome of a mistake in this arm's files; the arm itself is correct. `folder` must not have
    been used for another make: an EDS is read once."""
    said = reported(mistake.plant(arm, folder))
    warned = bool(said.lines)
    if said.refused:
        return Met(mistake.words, reported=True, refused=True)
    (folder / TRUE_URDF).write_text(arm.urdf)
    path = folder / "simulation.yaml"
    truth = yaml.safe_load(path.read_text()) | {"urdf": TRUE_URDF}
    truth["initial_position"] = dict.fromkeys(arm.names, POSE)
    path.write_text(in_yaml(truth))
    true_arm(load_robot(folder))  # raises if the simulator refuses it
    try:
        return _at_the_arm(mistake.words, arm.names[JOINT], folder, warned=warned)
    except ContactdError as error:  # the drives do not support the configuration
        return Met(mistake.words, warned, ended=f"contactd run: {error}")


def _at_the_arm(words: str, joint: str, folder: Path, *, warned: bool) -> Met:
    with served_daemon(
        folder.parent, folder, described=lambda robot, _: true_arm(robot)[0]
    ) as served:
        enabled = served.contactctl("enable")
        if enabled.exit_code:
            return Met(words, warned, ended=f"contactctl enable: {enabled.output}")
        served.run(0.5)
        armed = served.contactctl("arm").exit_code == 0
        served.contactctl("start")
        ran = served.rig.mode is Mode.TRACKING
        served.contactctl("stop")
        wiring = served.contactd("identify", "wiring", joint, "--yes")
        ended = wiring.output if wiring.exit_code else ""
        return Met(words, warned, False, ended, armed, ran, wiring.exit_code == 0)
