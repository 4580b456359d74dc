"""Session of `contactd identify` at a terminal, while time passes in lockstep, and its
interruption."""

import ctypes
import threading
from pathlib import Path

from click.testing import CliRunner, Result

from bench.rigs.lockstep import SINGLE_JOINT
from bench.rigs.served_daemon import ServedDaemon
from daemon.config import identified as file
from daemon.config.load import load_robot
from daemon.config.schema import ArmingStep
from daemon.modes.table import Mode
from programs.contactd import contactd
from programs.identify.merge import merged
from tests.programs.identify.commissioned_arm import CommissionedArm, Written

MOTION_S = 3.0
"""Motion after which a step has measured something [s]."""
HEARING_S = 0.1
"""Time that a command has to hear Ctrl-C, at each tick until the arm is stopped [s]."""
ENDING_S = 0.005
"""Time that it has to end, at each tick after that: it looks at the arm by the clock [s]."""


def wired_joint(folder: Path) -> CommissionedArm:
    """The single joint, on a bus as of a robot, its wiring checked; its true gap is 20 mrad."""

    def gap(written: Written) -> None:
        written["joints"][0]["half_gap"] = 0.02

    arm = CommissionedArm(folder, SINGLE_JOINT, change=gap, really=gap)
    wired = file.WiringEntry(date="2026-01-02T03:04:05+00:00", log="0", follows=1.0)
    identify(arm.folder, "wiring", wired)
    return arm


def identify(folder: Path, step: ArmingStep, entry: file.Entry) -> None:
    """Write identified.yaml as if the step had found `entry` of the single joint."""
    found = merged(load_robot(folder), step, {"joint": entry}, {"joint": 1})
    file.write_identified(folder / "identified.yaml", found)


class TypedCommand:
    """A command at the terminal, while time passes."""

    def __init__(self, served: ServedDaemon, *words: str) -> None:
        self.served = served
        self._results: list[Result] = []
        command = ["identify", *words, "--yes", "--socket", str(served.path)]

        def work() -> None:
            self._results.append(CliRunner().invoke(contactd.main, command))

        self._pause_s = 0.0
        self._thread = threading.Thread(target=work)
        self._thread.start()
        self.ticks_in_motion = 0

    @property
    def running(self) -> bool:
        """True until the command has ended."""
        return self._thread.is_alive()

    def tick(self) -> None:
        """Do a tick of the daemon, and let the command go on where it waits for none."""
        self.served.tick()
        self.ticks_in_motion += self.served.rig.mode is Mode.TRACKING
        self._thread.join(self._pause_s if self.served.service.control.readers else 0.005)

    def moves(self, seconds: float = MOTION_S) -> None:
        """Tick until the step's motion has lasted so long."""
        while self._thread.is_alive() and self.ticks_in_motion < 100 * seconds:
            self.tick()

    def ctrl_c(self) -> None:
        """Interrupt the command as a person would. Until the arm is stopped each tick gives it
        time to hear that, on a busy machine too."""
        number = ctypes.c_ulong(self._thread.ident or 0)
        ctypes.pythonapi.PyThreadState_SetAsyncExc(number, ctypes.py_object(KeyboardInterrupt))
        self._pause_s = ENDING_S
        while self._thread.is_alive() and self.served.rig.mode is Mode.TRACKING:
            self._thread.join(HEARING_S)
            self.tick()

    def ends(self) -> tuple[int, str]:
        """Exit status and output, in one line."""
        while self._thread.is_alive():
            self.tick()
        return self._results[0].exit_code, " ".join(self._results[0].output.split())


def stopped(served: ServedDaemon, *words: str, after_s: float = MOTION_S) -> tuple[int, str]:
    """Exit status and output of a command that Ctrl-C ended."""
    typed = TypedCommand(served, *words)
    typed.moves(after_s)
    typed.ctrl_c()
    return typed.ends()
