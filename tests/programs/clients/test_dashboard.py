"""Dashboard and status report as text, at the sizes they promise to fit."""

import io
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from rich.console import Console, RenderableType

from daemon.modes.table import Mode
from daemon.protocol.state import Notice, Permit, Snapshot, State, StreamState
from programs.clients.dashboard import (
    Dashboard,
    History,
    Lag,
    Summary,
    gap_bar,
    last_known,
    residual_bar,
)
from programs.clients.shown import MODE_STYLES, not_seen_to_stand
from programs.clients.status_report import status_report
from programs.clients.stream_words import quality_in_words
from tests.programs.clients.test_sensitivity import smallest

MakeState = Callable[..., State]


def text_of(shown: RenderableType, width: int, height: int, encoding: str = "utf-8") -> list[str]:
    """Lines as a terminal of that size would get them, without colours."""
    file = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    console = Console(file=file, width=width, height=height, color_system=None)
    console.print(shown)
    file.seek(0)
    return file.read().splitlines()


@pytest.fixture
def dashboard(make_state: MakeState, make_snapshot: Callable[[int], Snapshot]) -> Any:
    def make(ticks: range, **changes: object) -> Dashboard:
        history = History()
        for tick in ticks:
            history.add(make_state(tick))
        return Dashboard(make_snapshot(0), make_state(ticks[-1], **changes), history.summary())

    return make


@pytest.mark.parametrize(("width", "height"), [(100, 30), (80, 24)])
@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_fits(dashboard: Any, width: int, height: int, encoding: str) -> None:
    notices = [Notice(kind="note", text="x" * 200)] * 40
    frame = dashboard(range(0, 131))
    history = History()
    history.add(msgspec.structs.replace(frame.state, notices=notices))
    crowded = Dashboard(
        frame.snapshot,
        msgspec.structs.replace(frame.state, cause="why " * 60, flags=["odd " * 60]),
        history.summary(),
    )
    lines = text_of(crowded, width, height, encoding)
    assert len(lines) <= height - 1
    assert max(map(len, lines)) <= width
    joints = lines[3:11]
    assert not any("…" in line or "..." in line for line in joints)
    for joint, threshold in zip(frame.snapshot.joints, ["0.80", "0.50", "0.40"], strict=False):
        assert any(joint in line and threshold in line for line in joints)
    assert any("x" * 40 in line for line in lines)


STREAM = StreamState(
    sender="uid 1000 (pid 42)",
    phase="following",
    target=[0.5, -1.2],
    age_s=0.012,
    rate_hz=100.2,
    jitter_s=0.004,
    delay_s=0.0384,
    lost=12,
    dropped=0,
    bounded=1,
    refused=0,
    after_contact="hold",
)


def test_a_stream_has_a_line_of_its_own(dashboard: Any) -> None:
    frame = dashboard(range(0, 131), stream=STREAM)
    lines = text_of(frame, 100, 30)
    assert len(lines) <= 29
    (line,) = [line for line in lines if line.startswith(" stream ")]
    assert line.startswith(" stream following: ")
    assert "100 Hz, 12 ms old, jitter 4 ms, delay 38 ms, 12 lost" in line
    assert not any(line.startswith(" stream ") for line in text_of(dashboard(range(131)), 100, 30))


def test_a_guide_has_a_line_of_its_own(dashboard: Any) -> None:
    """A small terminal has room for it, too."""
    plain, led = (text_of(dashboard(range(131), **{"guide": g} if g else {}), 80, 24)
                  for g in ("", "stiff y z rx ry rz; frame tool"))  # fmt: skip
    (line,) = [line for line in led if "guide" in line]
    assert line == " guide for a hand: stiff y z rx ry rz; frame tool"
    assert len(led) <= 23
    assert not any("guide" in line for line in plain)


def test_how_far_the_arm_is_behind_its_target() -> None:
    assert quality_in_words(STREAM, [0.45, -1.19]).startswith("0.050 rad behind; 100 Hz")
    unknown = msgspec.structs.replace(STREAM, rate_hz=None, lost=0, bounded=0)
    assert quality_in_words(unknown, [0.5, -1.2]) == (
        "0.000 rad behind; 12 ms old, jitter 4 ms, delay 38 ms"
    )


def test_a_picture_of_the_past_says_so(dashboard: Any) -> None:
    lag = Lag()
    # The reader comes to a state 0.2 s after it was sent at best, later 0.9 s.
    seen = [lag.of(100.0 + now, time_s) for now, time_s in ((0.3, 0.0), (1.2, 1.0), (2.9, 2.0))]
    assert seen == pytest.approx([0.0, 0.0, 0.7])
    frame = dashboard(range(0, 131))
    for lag_s, reported in ((0.0, False), (0.4, False), (0.7, True)):
        late = Dashboard(frame.snapshot, frame.state, frame.summary, lag_s)
        lines = text_of(late, 80, 24)
        assert any("this picture is 0.7 s old" in line for line in lines) is reported
        assert len(lines) <= 23


def test_shows_what_matters(dashboard: Any) -> None:
    lines = text_of(dashboard(range(0, 131)), 100, 30)
    assert "ADMITTANCE" in lines[0]
    assert "ARMED" in lines[0]
    assert "quiet 0.0 s, then it goes on" in lines[0]
    assert "contact at LShoulderYaw" in lines[1]
    (touched,) = [line for line in lines if line.startswith(" LShoulderYaw")]
    for word in ("-1.30", "0.50", "-3.90", "operation enabled"):
        assert word in touched
    assert any("late p50 0.09, max 0.09 ms" in line for line in lines)
    assert any("1.00 s  contact" in line for line in lines)


def test_not_armed_and_still(dashboard: Any) -> None:
    lines = text_of(dashboard(range(0, 3), mode="off", armed=False, moving=False), 100, 30)
    assert "OFF" in lines[0]
    assert "not armed" in lines[0]
    assert "quiet" not in lines[0]


def test_without_a_residual_beside(dashboard: Any) -> None:
    lines = text_of(dashboard(range(0, 3), beside={}), 100, 30)
    assert not any("classical" in line for line in lines)


@pytest.mark.parametrize(
    ("phi", "expected"),
    [
        (0.0, "[----o----]"),
        (0.004, "[----|o---]"),
        (-0.004, "[---o|----]"),
        (0.0199, "[----|---o]"),
        (0.02, "[----|----o"),
        (-0.02, "o----|----]"),
        (9.0, "[----|----o"),
    ],
)
def test_gap_bar(phi: float, expected: str) -> None:
    assert gap_bar(phi, 0.02, 4).plain == expected


def test_joint_without_gap_has_a_bar_as_wide() -> None:
    bar = gap_bar(0.001, 0.0, 4).plain
    assert bar.strip() == "no gap"
    assert len(bar) == len(gap_bar(0.001, 0.02, 4).plain)


@pytest.mark.parametrize(
    ("residual", "expected", "style"),
    [
        (0.0, " :  |  : ", "green"),
        (0.5, " :  |# : ", "green"),
        (0.6, " :  |# : ", "yellow"),
        (-0.6, " : #|  : ", "yellow"),
        (1.0, " :  |##: ", "yellow"),
        (1.5, " :  |### ", "bold red"),
        (-1.5, " ###|  : ", "bold red"),
        (99.0, " :  |####", "bold red"),
        (-99.0, "####|  : ", "bold red"),
    ],
)
def test_residual_bar(residual: float, expected: str, style: str) -> None:
    bar = residual_bar(residual, 1.0, 4, ascii_only=True)
    assert len(bar.plain) == 9
    assert bar.plain.replace(":", " ").replace("|", " ") == (
        expected.replace(":", " ").replace("|", " ")
    )
    assert style in {span.style for span in bar.spans}


def test_threshold_marks_are_half_way() -> None:
    assert residual_bar(0.0, 1.0, 8, ascii_only=True).plain == "    :   |   :    "


def test_history_is_bounded_and_right(make_state: MakeState) -> None:
    history = History()
    assert history.summary() == Summary()
    for tick in range(5000):
        state = make_state(tick, notices=[Notice(kind="note", text=str(tick))])
        timing = msgspec.structs.replace(state.timing, lateness_us=float(tick), work_us=7.0)
        history.add(msgspec.structs.replace(state, timing=timing))
    summary = history.summary()
    assert summary.lateness_max_us == 4999.0
    assert summary.lateness_p50_us == 4500.0
    assert summary.work_max_us == 7.0
    assert [text for _, _, text in summary.events] == [str(t) for t in range(4988, 5000)]


@pytest.mark.parametrize("armed", [True, False])
def test_status_report(fake_daemon: Any, armed: bool) -> None:
    permit = Permit(uid=0, pid=7, detached=True, left_s=552.0, on_behalf_of="anna")
    status = msgspec.structs.replace(
        fake_daemon.status(),
        armed=armed,
        permit=permit if armed else None,
        cause="[bold]not markup[/bold]",
        mode="holding",
        disarmed="the lease of uid 0 (pid 7) ran out",
        disarmed_s=3717.5,
        contact=[0.8, 0.8],
        least=[0.16, 0.16],
        level_share=[1.0, 0.205],
        sensitivity=smallest(),
    )
    lines = text_of(status_report(status), 100, 60)
    report = "\n".join(line.rstrip() for line in lines)
    for word in (
        "HOLDING",
        "[bold]not markup[/bold]",
        "Romeo left arm",
        "1:02:05.0",
        "memory not locked",
    ):
        assert word in report
    assert ("failed  residual        LWristYaw feels +0.30 Nm" in report) is not armed
    assert ("passed  samples\n" in report) is not armed
    assert ("to arm anew  mode: the drives are off" in report) is armed
    assert ("not armed: the lease of uid 0 (pid 7) ran out (7 s ago)" in report) is not armed
    assert "smallest touch  in motion    at rest  configured    least  share\n" in report
    assert "shoulder          1.00 Nm   12.00 Nm     0.80 Nm  0.16 Nm    20%\nin motion:" in report
    assert ("armed by root (pid 7) on behalf of anna for another 9 min 12 s" in report) is armed
    (joint,) = [line for line in lines if line.startswith(" LWristPitch")]
    assert "0.20" in joint
    assert "operation enabled" in joint


@pytest.mark.parametrize(
    ("ago_s", "words"), [(0.4, "0 s"), (119.0, "119 s"), (125.0, "2 min"), (9000.0, "2 h")]
)
def test_status_report_says_how_long_ago_the_cause_was(
    fake_daemon: Any, ago_s: float, words: str
) -> None:
    """The cause of a mode may be over: `elbow feels +0.23 Nm` is of then, not of now."""
    status = msgspec.structs.replace(
        fake_daemon.status(), uptime_s=10000.0, since_s=10000.0 - ago_s, cause="elbow feels it"
    )
    (line,) = (x for x in text_of(status_report(status), 100, 40) if x.startswith("cause"))
    assert line.rstrip().endswith(f"elbow feels it ({words} ago)")


def test_status_report_says_what_to_do_about_a_fault(fake_daemon: Any) -> None:
    def report(advice: str) -> list[str]:
        status = msgspec.structs.replace(fake_daemon.status(), mode="faulted", advice=advice)
        return [line.strip() for line in text_of(status_report(status), 100, 40)]

    assert "to do         check the cable, then `contactctl reset`" in report(
        "check the cable, then `contactctl reset`"
    )
    assert not [line for line in report("") if line.startswith("to do")]


DOUBT = {"mode": "faulted", "unproved": ["LElbowRoll", "LWristYaw"], "silenced": True}


@pytest.mark.parametrize("width", [40, 80, 100])
def test_what_is_not_seen_to_stand_is_in_the_headline(
    dashboard: Any, fake_daemon: Any, width: int
) -> None:
    frame = dashboard(range(0, 131), armed=False, cause="why", **DOUBT)
    status = msgspec.structs.replace(fake_daemon.status(), **DOUBT)
    for shown, most in ((frame, 23), (status_report(status), 100)):
        lines = text_of(shown, width, 24)
        assert len(lines) <= most
        assert max(map(len, lines)) <= width
        reported = " ".join(word for line in lines[:9] for word in line.split())
        assert "not seen to stand: LElbowRoll, LWristYaw" in reported
        assert "silent until reset: the drives hear nothing of contactd" in reported
        assert reported.index("FAULTED") < reported.index("not seen to stand")


def test_a_doubt_is_red_and_gone_when_every_joint_stands(dashboard: Any) -> None:
    assert "bold red" in str(not_seen_to_stand(dashboard(range(0, 3), **DOUBT).state).style)
    proved = {**DOUBT, "unproved": [], "silenced": False}
    # Off, its brakes may take a moment: nothing to be red about.
    for changes in (proved, {**DOUBT, "mode": "off"}):
        frame = dashboard(range(0, 3), **changes)
        assert not not_seen_to_stand(frame.state)
        assert text_of(frame, 80, 24)[1] == " start"


DEAF = "not sensing contact: "
T_S = 1.30  # of the State that is shown
# Since when joints sense [s], and with a minus since when they do not; and what is said of them.
SENSING: dict[str, tuple[list[float], str]] = {
    "all do": ([0.03] * 7, ""),
    "one": ([0.03, 0.03, -0.9, *[0.03] * 4], "LElbowRoll for 0.4 s"),
    "two at once": ([0.03, -0.9, -0.9, *[0.03] * 4], "LShoulderYaw, LElbowRoll for 0.4 s"),
    "two": ([0.03, -0.1, -0.9, *[0.03] * 4], "LShoulderYaw for 1.2 s; LElbowRoll for 0.4 s"),
    "all at once": ([-0.9] * 7, "all joints for 0.4 s"),
}


def sensing(since_s: list[float]) -> dict[str, Any]:
    return {"sensing": [s > 0 for s in since_s], "sensing_since_s": [abs(s) for s in since_s]}


@pytest.mark.parametrize("width", [40, 80, 100])
@pytest.mark.parametrize("name", SENSING)
def test_what_does_not_sense_is_in_the_headline(
    dashboard: Any, fake_daemon: Any, width: int, name: str
) -> None:
    since_s, words = SENSING[name]
    frame = dashboard(range(0, 131), **sensing(since_s))
    status = msgspec.structs.replace(
        fake_daemon.status(), mode="tracking", uptime_s=T_S, **sensing(since_s)
    )
    for shown, most in ((frame, 23), (status_report(status), 100)):
        lines = text_of(shown, width, 24)
        assert len(lines) <= most
        assert max(map(len, lines)) <= width
        reported = " ".join(word for line in lines[:5] for word in line.split())
        assert (f"{DEAF}{words}" in reported) == bool(words)
        assert words or DEAF not in "".join(lines)
    assert "bold red" in str(frame._not_sensing().style)


def test_how_long_every_joint_has_sensed(dashboard: Any, fake_daemon: Any) -> None:
    all_do = sensing([0.03] * 6 + [0.7])
    line, row = "all sense 0:00:00.6", "sensing       every joint, for 0:00:00.6"

    def shown(width: int, **changes: Any) -> tuple[bool, bool]:
        status = msgspec.structs.replace(
            fake_daemon.status(), **{"mode": "holding", "uptime_s": T_S, **changes}
        )
        frame = dashboard(range(0, 131), **changes)
        report = text_of(status_report(status), width, 40)
        return (
            any(line in each for each in text_of(frame, width, 24)),
            any(row in each for each in report),
        )

    assert shown(100, **all_do) == (True, True)
    assert shown(80, **all_do) == (False, True), "the line is full"
    assert shown(100, **all_do, mode="off") == (False, False), "no contact counts"
    assert shown(100, **sensing([-0.9] + [0.03] * 6)) == (False, False)
    assert shown(100, sensing=None, sensing_since_s=None) == (False, False), "of format 1"


def test_status_report_before_the_first_samples(fake_daemon: Any) -> None:
    status = msgspec.structs.replace(fake_daemon.status(), drives=[], side=[], age_ticks=[])
    assert "7 joints, no samples from the drives yet" in "\n".join(
        text_of(status_report(status), 100, 40)
    )


def test_every_mode_has_a_style() -> None:
    assert MODE_STYLES.keys() == set(Mode)


@pytest.mark.parametrize("silent_s", [0.0, 0.4, 0.5, 1.8])
def test_a_silent_daemon_is_not_live(dashboard: Any, silent_s: float) -> None:
    frame = dashboard(range(0, 131))
    shown = Dashboard(frame.snapshot, frame.state, frame.summary, silent_s=silent_s)
    first, second, *_ = text_of(shown, 80, 24)
    stale = silent_s >= 0.5
    assert first.startswith(" was ADMITTANCE   was armed   ") is stale
    assert (f"NOT LIVE: nothing for {silent_s:.1f} s" in second) is stale
    assert len(text_of(shown, 80, 24)) <= 23


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"mode": Mode.OFF, "armed": False}, "last known: off"),
        ({"mode": Mode.OFF, "armed": False, "unproved": ["LElbowRoll"]}, "if the arm moves"),
        (
            {"mode": Mode.TRACKING},
            "last known: tracking, armed; use the emergency stop if the arm moves",
        ),
        ({"mode": Mode.FAULTED, "armed": False}, "use the emergency stop if the arm moves"),
    ],
)
def test_what_was_known_last(make_state: MakeState, changes: dict[str, Any], said: str) -> None:
    assert last_known(make_state(0, **changes)).endswith(said)
