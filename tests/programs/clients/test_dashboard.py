"""Dashboard and status report as text, at the sizes they promise to fit."""

import io
from pathlib import Path
from typing import Any

import msgspec
import pytest
from rich.console import Console, RenderableType

from daemon.modes.table import Mode
from daemon.protocol.state import Notice, Permit, StreamState
from programs.clients.dashboard import (
    Dashboard,
    History,
    Lag,
    Summary,
    gap_bar,
    last_known,
    residual_bar,
)
from programs.clients.status_report import status_report
from programs.clients.stream_words import quality_in_words
from programs.clients.styles import MODE_STYLES, not_seen_to_stand
from tests.fake_daemon import FakeDaemon, snapshot_at, state_at
from tests.golden_words import same_words
from tests.programs.clients.test_sensitivity import smallest

GOLDEN = Path(__file__).with_name("golden")


def text_of(shown: RenderableType, width: int, height: int, encoding: str = "utf-8") -> list[str]:
    """Lines as a terminal of that size would get them, without colours."""
    file = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    console = Console(file=file, width=width, height=height, color_system=None)
    console.print(shown)
    file.seek(0)
    return file.read().splitlines()


@pytest.fixture
def dashboard() -> Any:
    def make(ticks: range, **changes: object) -> Dashboard:
        history = History()
        for tick in ticks:
            history.add(state_at(tick))
        return Dashboard(snapshot_at(0), state_at(ticks[-1], **changes), history.summary())

    return make


@pytest.mark.parametrize(("width", "height"), [(100, 30), (80, 24)])
@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_it_fits_the_terminal(dashboard: Any, width: int, height: int, encoding: str) -> None:
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


DOUBT = {"mode": "faulted", "unproved": ["LElbowRoll", "LWristYaw"], "silenced": True}


def sensing(*since_s: float) -> dict[str, Any]:
    """Since when joints sense [s], with a minus since when they do not; the others 0.03."""
    all_s = [*since_s, *[0.03] * (7 - len(since_s))]
    return {"sensing": [s > 0 for s in all_s], "sensing_since_s": [abs(s) for s in all_s]}


#: What a State, or a Status, has that another has not.
SCENES: dict[str, dict[str, Any]] = {
    "armed, and yields": {},
    "off": {"mode": "off", "armed": False, "moving": False},
    "no residual beside": {"beside": {}},
    "a stream": {"stream": STREAM},
    "a guide": {"guide": "stiff y z rx ry rz; frame tool"},
    "not seen to stand": {"armed": False, "cause": "why", **DOUBT},
    "one joint does not sense": sensing(0.03, 0.03, -0.9),
    "two since one moment": sensing(0.03, -0.9, -0.9),
    "two since two": sensing(0.03, -0.1, -0.9),
    "no joint senses": sensing(*[-0.9] * 7),
    "all sense": sensing(*[0.03] * 6, 0.7),
    "off, where no contact counts": {"mode": "off", **sensing(*[0.03] * 6, 0.7)},
    "of format 1": {"sensing": None, "sensing_since_s": None},
}
OF_PERMIT = Permit(uid=0, pid=7, detached=True, left_s=552.0, on_behalf_of="anna")
SURE: dict[str, Any] = {
    "cause": "[bold]not markup[/bold]",
    "mode": "holding",
    "contact": [0.8, 0.8],
    "least": [0.16, 0.16],
    "level_share": [1.0, 0.205],
    "sensitivity": smallest(),
}
STATUSES: dict[str, dict[str, Any]] = {
    "armed": {**SURE, "armed": True, "permit": OF_PERMIT},
    "disarmed": {
        **SURE, "armed": False, "permit": None, "disarmed_s": 3717.5,
        "disarmed": "the lease of uid 0 (pid 7) ran out",
    },
    "a fault": {"mode": "faulted", "advice": "check the cable, then `contactctl reset`"},
    "before the first samples": {"drives": [], "side": [], "age_ticks": []},
    **{
        f"a cause of {ago_s} s ago": {"uptime_s": 1e4, "since_s": 1e4 - ago_s, "cause": "it"}
        for ago_s in (0.4, 119.0, 125.0, 9000.0)
    },
    **{
        name: {"mode": "tracking", "uptime_s": 1.30, **SCENES[name]}
        for name in SCENES
        if {"sensing", "unproved"} & SCENES[name].keys()
    },
}  # fmt: skip


def pictures(of: dict[str, list[str]]) -> str:
    return "\n".join(line for name, shown in of.items() for line in (f"== {name}", *shown))


@pytest.mark.parametrize(("width", "height"), [(100, 30), (80, 24), (40, 24)])
def test_words_of_every_scene_at_each_width(dashboard: Any, width: int, height: int) -> None:
    frames = {name: dashboard(range(131), **changes) for name, changes in SCENES.items()}
    plain = frames["armed, and yields"]
    for lag_s, silent_s in ((0.4, 0.4), (0.7, 0.0), (0.0, 0.5)):
        frames[f"{lag_s} s behind, silent for {silent_s} s"] = Dashboard(
            plain.snapshot, plain.state, plain.summary, lag_s, silent_s=silent_s
        )
    shown = {name: text_of(frame, width, height) for name, frame in frames.items()}
    same_words(GOLDEN / f"dashboard_{width}.txt", pictures(shown))
    assert max(len(lines) for lines in shown.values()) <= height - 1
    assert max(len(line) for lines in shown.values() for line in lines) <= width


@pytest.mark.parametrize("width", [100, 40])
def test_words_of_a_status(tmp_path: Path, width: int) -> None:
    plain = FakeDaemon(tmp_path / "control").status()
    shown = {
        name: text_of(status_report(msgspec.structs.replace(plain, **changes)), width, 60)
        for name, changes in STATUSES.items()
    }
    same_words(GOLDEN / f"status_{width}.txt", pictures(shown))


def test_a_late_reader_lags() -> None:
    """To a state 0.2 s after it was sent at best, later 0.9 s."""
    lag = Lag()
    seen = [lag.of(100.0 + now, time_s) for now, time_s in ((0.3, 0.0), (1.2, 1.0), (2.9, 2.0))]
    assert seen == pytest.approx([0.0, 0.0, 0.7])


def test_how_far_the_arm_is_behind_its_target() -> None:
    assert quality_in_words(STREAM, [0.45, -1.19]).startswith("0.050 rad behind; 100 Hz")
    unknown = msgspec.structs.replace(STREAM, rate_hz=None, lost=0, bounded=0)
    assert quality_in_words(unknown, [0.5, -1.2]) == (
        "0.000 rad behind; 12 ms old, jitter 4 ms, delay 38 ms"
    )


@pytest.mark.parametrize(
    ("phi", "expected"),
    [
        (0.0, "[----o----]"), (0.004, "[----|o---]"), (-0.004, "[---o|----]"),
        (0.0199, "[----|---o]"), (0.02, "[----|----o"), (-0.02, "o----|----]"),
        (9.0, "[----|----o"),
    ],
)  # fmt: skip
def test_gap_bar(phi: float, expected: str) -> None:
    assert gap_bar(phi, 0.02, 4).plain == expected


def test_joint_without_gap_has_a_bar_as_wide() -> None:
    bar = gap_bar(0.001, 0.0, 4).plain
    assert bar.strip() == "no gap"
    assert len(bar) == len(gap_bar(0.001, 0.02, 4).plain)


@pytest.mark.parametrize(
    ("residual", "expected", "style"),
    [
        (0.0, " :  |  : ", "green"), (0.5, " :  |# : ", "green"), (0.6, " :  |# : ", "yellow"),
        (-0.6, " : #|  : ", "yellow"), (1.0, " :  |##: ", "yellow"), (1.5, " :  |### ", "bold red"),
        (-1.5, " ###|  : ", "bold red"), (99.0, " :  |####", "bold red"),
        (-99.0, "####|  : ", "bold red"),
    ],
)  # fmt: skip
def test_residual_bar(residual: float, expected: str, style: str) -> None:
    bar = residual_bar(residual, 1.0, 4, ascii_only=True)
    assert len(bar.plain) == 9
    assert bar.plain.replace(":", " ").replace("|", " ") == (
        expected.replace(":", " ").replace("|", " ")
    )
    assert style in {span.style for span in bar.spans}


def test_threshold_marks_are_half_way() -> None:
    assert residual_bar(0.0, 1.0, 8, ascii_only=True).plain == "    :   |   :    "


def test_the_time_that_is_left_is_shown(dashboard: Any) -> None:
    shown = "".join(text_of(dashboard(range(0, 3), mode=Mode.ADMITTANCE, quiet_s=1.1), 80, 24))
    assert "continues in 0.9 s if untouched" in shown


def test_history_is_bounded_and_summarised() -> None:
    history = History()
    assert history.summary() == Summary()
    for tick in range(5000):
        state = state_at(tick, notices=[Notice(kind="note", text=str(tick))])
        timing = msgspec.structs.replace(state.timing, lateness_us=float(tick), work_us=7.0)
        history.add(msgspec.structs.replace(state, timing=timing))
    summary = history.summary()
    assert summary.lateness_max_us == 4999.0
    assert summary.lateness_p50_us == 4500.0
    assert summary.work_max_us == 7.0
    assert [text for _, _, text in summary.events] == [str(t) for t in range(4988, 5000)]


def test_a_doubt_is_red_and_gone_when_every_joint_stands(dashboard: Any) -> None:
    assert "bold red" in str(not_seen_to_stand(dashboard(range(0, 3), **DOUBT).state).style)
    proved = {**DOUBT, "unproved": [], "silenced": False}
    # Off, its brakes may take a moment: nothing to be red about.
    for changes in (proved, {**DOUBT, "mode": "off"}):
        frame = dashboard(range(0, 3), **changes)
        assert not not_seen_to_stand(frame.state)
        assert text_of(frame, 80, 24)[1] == " start"


def test_every_mode_has_a_style() -> None:
    assert MODE_STYLES.keys() == set(Mode)


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
def test_the_last_known_state_is_named_with_the_advice(changes: dict[str, Any], said: str) -> None:
    assert last_known(state_at(0, **changes)).endswith(said)
