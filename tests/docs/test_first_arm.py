"""The page "Your first arm": its commands, typed in their order at an arm in lockstep."""

import shlex
import shutil
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from bench.rigs.served_daemon import ServedDaemon, served_daemon
from daemon.modes.table import Mode
from daemon.protocol.socket_path import default_hand_path
from programs.contactctl.contactctl import main as contactctl
from programs.contactd.contactd import main as contactd
from programs.simulate.simulated_robot import true_arm
from simulator.hand_socket import HandSocket

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "first_arm.md"
HAND = ["hand", "gap", "column"]
BY_HAND = ["identify", "gap", "column", "--by-hand"]
STANDS = "identify gap-column"  # the trajectory in which its motor waits for the hand
IDLE_S = 0.01  # between ticks while a step computes


def commands() -> list[list[str]]:
    """The indented lines of the page, as words."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    return [shlex.split(line) for line in lines if line.startswith("    contact")]


class Terminals:
    """Three terminals of a person: what is typed, in lockstep with the simulated arm."""

    def __init__(self, folder: Path, open_: ExitStack) -> None:
        self._folder, self._open = folder, open_
        self.served: ServedDaemon | None = None

    def type(self, words: list[str]) -> Result:
        """One command; a daemon that is started ends the one before."""
        match words:
            case ["contactd", "simulate", _]:
                return Result(CliRunner(), b"", b"", b"", None, 0, None)  # it is there with `run`
            case ["contactd", "run", folder]:
                self._open.close()
                self.served = self._open.enter_context(
                    served_daemon(
                        self._folder, Path(folder), described=lambda robot, _: true_arm(robot)[0]
                    )
                )
                self.served.computing_s = IDLE_S
                return Result(CliRunner(), b"", b"", b"", None, 0, None)
            case ["contactd", "identify", *more]:
                assert self.served is not None
                result = self.served.contactd("identify", *more, "--yes")  # as one answers
                if "not written: column" in result.output:
                    result = self._by_hand(self.served)
            case ["contactd", *more]:
                return CliRunner().invoke(contactd, more)
            case ["contactctl", *more]:
                assert self.served is not None
                result = self._with_hand(self.served, more)
            case _:
                raise AssertionError(f"not a command of ours: {words}")
        self.served.run(1.0)
        return result

    def _by_hand(self, served: ServedDaemon) -> Result:
        """Words of the page on the one joint that may want a hand."""
        over = threading.Event()

        def hand() -> None:
            follower = served.rig.tick.controller.motion.follower
            while not over.wait(0.005) and follower.place.path.name != STANDS:
                follower = served.rig.tick.controller.motion.follower
            assert CliRunner().invoke(contactctl, HAND).exit_code == 0

        person = threading.Thread(target=hand)
        with self._hand(served):
            person.start()
            result = served.contactd(*BY_HAND, "--yes")
            over.set()
            person.join()
            assert served.contactctl("hand", "release").exit_code == 0
        return result

    def _with_hand(self, served: ServedDaemon, words: list[str]) -> Result:
        with self._hand(served):
            return served.contactctl(*words)

    @staticmethod
    @contextmanager
    def _hand(served: ServedDaemon) -> Iterator[None]:
        """The simulator's hand listens meanwhile, as `contactd simulate` lets it."""
        over = threading.Event()

        def listen() -> None:
            while not over.wait(0.005):
                hand_socket.serve(served.rig.arm.hand.take)

        with closing(HandSocket(default_hand_path())) as hand_socket:
            listener = threading.Thread(target=listen)
            listener.start()
            try:
                yield
            finally:
                over.set()
                listener.join()


@pytest.fixture
def terminals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminals]:
    shutil.copytree(ROOT / "configs" / "desk_arm", tmp_path / "configs" / "desk_arm")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with ExitStack() as open_:
        yield Terminals(tmp_path, open_)


def test_the_page_leads_to_an_armed_arm_that_yields(terminals: Terminals) -> None:
    typed = commands()
    for words in typed:
        result = terminals.type(words)
        assert result.exit_code == 0, f"{shlex.join(words)}\n{result.output}"
        assert terminals.served is None or terminals.served.rig.mode is not Mode.FAULTED, words
        if words[:3] == ["contactctl", "hand", "lean"]:
            assert terminals.served is not None
            assert terminals.served.rig.mode is Mode.ADMITTANCE
    page = PAGE.read_text(encoding="utf-8")
    assert shlex.join(["contactctl", *HAND]) in page
    assert shlex.join(["contactd", *BY_HAND]) in page
    assert ["contactctl", "hand", "lean"] in [words[:3] for words in typed]
    assert terminals.served is not None
    assert terminals.served.rig.mode is Mode.OFF
