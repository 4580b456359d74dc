"""Live hand: acts asked for at the simulator's own socket, and `contactctl hand`."""

import socket
import threading
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from msgspec.structs import replace

from common.errors import BusError, ConfigurationError
from programs.contactctl.contactctl import main
from programs.simulate.simulate import _live_hand
from simulator.hand import TAKING_S, VISIT_S, Hand
from simulator.hand_script import Clamp, Gap, Give, Guide, Lean, Press, Push, Release, described
from simulator.hand_socket import HandSocket

NAMES = ("shoulder", "elbow")
Q, STILL = np.array([0.1, -0.2]), np.zeros(2)


def a_hand(**more) -> Hand:
    return Hand((), NAMES, np.full(2, 10.0), **more)


def torque(hand: Hand, q=Q, q_dot=STILL) -> list[float]:
    out = np.zeros(2)
    hand.torque(np.array(q), np.array(q_dot), out)
    return out.tolist()


def test_what_is_asked_for_begins_at_once_and_without_a_script():
    hand = a_hand()
    assert not hand.busy
    assert hand.take(Push(at_s=9.0, joint="elbow", torque=2.0, duration_s=0.5)) == "push elbow 2 Nm"
    assert hand.busy
    assert not hand.began
    assert hand.update(3.0, Q) == ["begin push elbow 2 Nm"]
    hand.update(3.2, Q)
    assert torque(hand) == [0.0, 2.0]
    assert hand.update(3.6, Q) == ["end push elbow 2 Nm"]
    assert not hand.busy
    with pytest.raises(ConfigurationError, match=r"^no joint 'thumb'; there are: shoulder, elbow$"):
        hand.take(Lean(at_s=0.0, joint="thumb", torque=1.0))


def test_a_position_beyond_the_end_stops_is_refused():
    hand = a_hand(stops=(np.array([-1.0, -2.0]), 1.5))
    with pytest.raises(
        ConfigurationError, match=r"^elbow: -2.1 rad is beyond its end stops, -2 to"
    ):
        hand.take(Guide(at_s=0.0, to={"shoulder": 1.5, "elbow": -2.1}, speed=0.3))
    assert not hand.busy


def test_leaning_rises_and_stays_until_release():
    hand = a_hand()
    leaning = Lean(at_s=0.0, joint="shoulder", torque=-3.0, rise_s=1.0)
    assert hand.take(leaning) == "lean on shoulder with -3 Nm, until `release`"
    hand.update(1.0, Q)
    hand.update(1.5, Q)
    assert torque(hand) == [-1.5, 0.0]
    hand.update(100.0, Q)
    assert torque(hand) == [-3.0, 0.0]
    hand.take(Release(at_s=0.0))
    hand.update(100.1, Q)
    assert torque(hand) == [0.0, 0.0]
    assert not hand.busy


def test_a_press_states_when_it_ends():
    press = Press(at_s=0.0, force=(0.0, -8.0, 0.0))
    assert described(press) == "press the tool with 0 -8 0 N, until `release`"
    assert described(replace(press, duration_s=2.0)) == "press the tool with 0 -8 0 N for 2 s"


def test_a_clamp_is_hard_where_the_joint_was():
    hand = a_hand()
    hand.take(Clamp(at_s=0.0, joints=("elbow",)))
    hand.update(0.0, Q)
    assert torque(hand, Q + 0.01) == pytest.approx([0.0, -10.0])
    assert torque(hand, Q + 1.0) == pytest.approx([0.0, -100.0])


def test_gap_goes_to_both_borders_and_carries_the_weight():
    hand = a_hand(weight=lambda q: np.array([5.0, 7.0]))
    hand.take(Gap(at_s=0.0, joint="elbow", torque=1.5, times=2))
    hand.update(0.0, Q)
    hand.update(0.5 * TAKING_S, Q)
    assert torque(hand) == pytest.approx([0.0, 3.5])  # half of the weight, and no push yet
    pressed = []
    for visit in (0, 1):
        hand.update(TAKING_S + (visit + 0.9) * VISIT_S, Q)
        pressed.append(torque(hand)[1] - 7.0)
    assert pressed == pytest.approx([1.5, -1.5])
    # A link in motion is damped.
    assert torque(hand, Q, [0.0, 0.1])[1] == pytest.approx(7.0 - 1.5 - 0.3)
    assert hand.update(TAKING_S + 2.1 * VISIT_S, Q) == [
        "end move elbow in its gap with 1.5 Nm, 2 times"
    ]
    assert torque(hand) == [0.0, 0.0]


@pytest.fixture
def hand_socket(tmp_path: Path):
    """A socket that is served by a thread, and what was asked for there."""
    asked: list[object] = []

    def take(act) -> str:
        if getattr(act, "joint", "") == "thumb":
            raise ConfigurationError("no thumb")
        asked.append(act)
        return "done"

    one, stop = HandSocket(tmp_path / "hand"), threading.Event()

    def serve() -> None:
        while not stop.wait(0.005):
            one.serve(take)

    thread = threading.Thread(target=serve)
    thread.start()
    yield one.path, asked
    stop.set()
    thread.join()
    one.close()
    assert not one.path.exists()


@pytest.mark.parametrize(
    ("words", "act"),
    [
        (["push", "elbow", "3Nm"], Push(at_s=0, joint="elbow", torque=3, duration_s=0.5,
                                        shape="pulse")),
        (["push", "--seconds", "2", "--", "elbow", "-3 Nm"],
         Push(at_s=0, joint="elbow", torque=-3, duration_s=2, shape="pulse")),
        (["lean", "elbow", "1.5"], Lean(at_s=0, joint="elbow", torque=1.5)),
        (["clamp", "elbow", "shoulder"], Clamp(at_s=0, joints=("elbow", "shoulder"))),
        (["gap", "elbow", "--torque", "2Nm"], Gap(at_s=0, joint="elbow", torque=2, times=40)),
        (["carry", "0.5kg"], Give(at_s=0, mass=0.5)),
        (["carry", "0.5kg", "--com", "0.1", "0", "-0.02"],
         Give(at_s=0, mass=0.5, com=(0.1, 0.0, -0.02))),
        (["release"], Release(at_s=0)),
    ],
)  # fmt: skip
def test_a_command_is_an_act(hand_socket, words, act):
    path, asked = hand_socket
    result = CliRunner().invoke(main, ["hand", "--hand-socket", str(path), *words])
    assert (result.exit_code, result.output) == (0, "done\n")
    assert asked == [act]


@pytest.mark.parametrize(
    ("words", "status", "says"),
    [
        (["push", "thumb", "3"], 1, "no thumb"),
        (["push", "elbow", "3kg"], 2, "is no value in Nm"),
        (["carry", "--", "-1"], 2, "'-1' is out of range: 0 to 100 kg"),
        (["nudge", "elbow"], 2, "no command 'nudge'; there are: push, lean, "),
    ],
)
def test_what_a_hand_cannot_do_is_refused(hand_socket, words, status, says):
    path, asked = hand_socket
    result = CliRunner().invoke(main, ["hand", "--hand-socket", str(path), *words])
    assert result.exit_code == status
    assert says in result.output
    assert asked == []


def test_there_is_no_hand_without_a_simulator(tmp_path: Path):
    words = ["hand", "--hand-socket", str(tmp_path / "none"), "release"]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 69
    said = f"no simulated hand answers at {tmp_path}/none: No such file or directory; is `contactd"
    assert said in result.output
    assert "with that --hand-socket? Without it both use " in result.output


def test_a_second_simulator_is_refused_and_a_socket_left_over_is_not(tmp_path: Path):
    first = HandSocket(tmp_path / "hand")
    assert (tmp_path / "hand").stat().st_mode & 0o777 == 0o600
    with pytest.raises(BusError, match="another simulator"):
        HandSocket(tmp_path / "hand")
    first._socket.close()  # as if it had been killed
    HandSocket(tmp_path / "hand").close()


def test_a_simulation_beside_another_goes_without_a_live_hand_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("CONTACTD_HAND", str(tmp_path / "hand"))
    with _live_hand(None) as first, _live_hand(None) as second:
        assert first is not None
        assert second is None
        assert "no live hand here: another simulator listens" in capsys.readouterr().err
        with pytest.raises(BusError), _live_hand(tmp_path / "hand"):
            pass
        with _live_hand(tmp_path / "other") as third:
            assert third is not None
    assert list(tmp_path.iterdir()) == []


def test_a_client_that_says_nothing_or_nonsense_does_no_harm(tmp_path: Path):
    hand_socket = HandSocket(tmp_path / "hand")
    for said in (b"", b"{", b"\xff\n", b"[]\n", b'{"act": "fly"}\n'):
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
            client.connect(str(hand_socket.path))
            client.sendall(said)
            client.shutdown(socket.SHUT_WR)
            hand_socket.serve(lambda _: "")
            assert b'"ok":false' in client.recv(4096)
    hand_socket.close()


def test_a_file_in_the_place_of_the_socket_is_kept(tmp_path: Path):
    file = tmp_path / "config.yaml"
    file.write_text("version: 1\n")
    with pytest.raises(BusError, match=r"config.yaml: it exists and is not a socket"):
        HandSocket(file)
    assert file.read_text() == "version: 1\n"
