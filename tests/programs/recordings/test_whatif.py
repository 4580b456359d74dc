"""`contactd whatif`: contacts of a recording by other settings; by the same, those recorded."""

import json
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from bench.rigs.lockstep import SINGLE_JOINT
from bench.rigs.recorded_arm import made
from common.errors import ConfigurationError
from daemon.protocol.state import Contact, Snapshot, State
from estimator.alarms import critical_collision
from programs.clients.log_reader import read_log
from programs.clients.replay import SAME_ESTIMATOR
from programs.contactd.contactd import main
from programs.recordings.labels import Label
from programs.recordings.many import LabelledRecording, answers, kept_answer
from programs.recordings.question import Answer, Question
from programs.recordings.settings import changed_configuration
from programs.recordings.whatif import ask
from tests.programs.clients.test_recorder import FORMATS
from tests.programs.clients.test_replay import written

JOINT = "joint"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A joint in motion, pushed every six seconds."""
    return made(tmp_path_factory.mktemp("whatif") / "made.mcap", SINGLE_JOINT, 24.0, seed=4)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def noticed(path: Path, level: str) -> list[tuple[State, Contact]]:
    """Contacts of this level that the daemon reported, with their States."""
    return [
        (state, notice.contact)
        for state in read_log(path)
        if isinstance(state, State)
        for notice in state.notices
        if notice.contact is not None and notice.contact.level == level
    ]


def notices(path: Path) -> list[tuple[str, float]]:
    """Contacts that the daemon reported, as `contacts` has them."""
    return [(contact.joint, contact.torque) for _, contact in noticed(path, "contact")]


def contacts(answer: Answer) -> list[tuple[str, float]]:
    assert not answer.failed
    return [(one.joint, one.torque) for one in answer.contacts]


def snapshot_of(path: Path) -> Snapshot:
    snapshot = next(iter(read_log(path)))
    assert isinstance(snapshot, Snapshot)
    return snapshot


def configured(path: Path) -> float:
    return snapshot_of(path).thresholds[0]


def test_contacts_by_the_recorded_settings_are_those_of_the_daemon(recording: Path) -> None:
    level = configured(recording)
    answer = ask(recording, Question(levels={JOINT: (level,)}))
    assert contacts(answer) == notices(recording)
    assert len(answer.contacts) >= 4
    assert answer.curves[JOINT].contacts == [len(answer.contacts)]
    assert answer.reaction_s is None  # not armed


@pytest.mark.parametrize("change", [("estimator.gain", "25"), ("estimator.debounce", "1")])
def test_a_replay_with_the_same_settings_changes_nothing(
    recording: Path, change: tuple[str, str]
) -> None:
    answer = ask(recording, Question(changes=(change,)))
    assert contacts(answer) == notices(recording)
    assert answer.recorded == answer.contacts


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.3, 2.5])
def test_another_level_makes_the_contacts_that_a_replay_with_it_makes(
    recording: Path, factor: float
) -> None:
    level = round(factor * configured(recording), 6)
    swept = ask(recording, Question(levels={JOINT: (level,)})).curves[JOINT]
    change = (f"joints.{JOINT}.thresholds", f"{{contact: {level}, collision: {20.0 * level}}}")
    replayed = ask(recording, Question(changes=(change,)))
    # What is learned of a level depends a little on the level: one contact may split, or join.
    assert abs(swept.contacts[0] - len(replayed.contacts)) <= 1


@pytest.mark.parametrize("collision", [0.7, 1.5, 2.5])
def test_another_collision_level_makes_the_collisions_that_an_arm_with_it_reports(
    tmp_path: Path, collision: float
) -> None:
    arm = shutil.copytree(SINGLE_JOINT.parent, tmp_path / "configs") / SINGLE_JOINT.name
    text = (arm / "config.yaml").read_text()
    assert "collision: 4.0," in text
    (arm / "config.yaml").write_text(text.replace("collision: 4.0,", f"collision: {collision},"))
    path = made(tmp_path / "hit.mcap", arm, 14.0, seed=4)
    said = noticed(path, "collision")
    question = Question(levels={JOINT: (1.0,)}, collisions={JOINT: (collision, 50.0)})
    curves = ask(path, question).curves
    assert curves[f"{JOINT}, collision"].contacts == [len(said), 0]
    assert said
    for state, contact in said:
        rows = [np.array([row]) for row in (state.residual, state.threshold, state.level_share)]
        critical = critical_collision(rows[0], rows[1], np.array([configured(path)]), rows[2])
        assert critical[0, 0] == pytest.approx(
            abs(contact.torque) - contact.threshold + collision, abs=1e-9
        )
    assert list(curves) == [JOINT, f"{JOINT}, collision", "the arm"]


def test_other_friction_makes_other_residuals(recording: Path) -> None:
    change = (f"joints.{JOINT}.friction.motor_coulomb", "0.0")
    answer = ask(recording, Question(changes=(change,), fresh=True))
    assert not answer.failed
    assert contacts(answer) != notices(recording)


def test_a_residual_that_ran_beside_can_decide(recording: Path) -> None:
    answer = ask(recording, Question(residual="classical"))
    assert len(answer.contacts) > len(answer.recorded) == len(notices(recording))
    assert "has no residual 'kalman'; there are: backlash, classical" in (
        ask(recording, Question(residual="kalman")).failed
    )


def test_labels_are_found_at_low_levels_and_not_at_high_ones(recording: Path) -> None:
    first, second = ask(recording, Question()).contacts[:2]
    labels = (
        Label(first.time_s - 0.1, first.time_s + 0.4, JOINT),
        Label(second.time_s - 0.1, second.time_s + 0.4, "any"),
    )
    levels = (configured(recording), 100.0)
    curve = ask(recording, Question(levels={JOINT: levels}), labels).curves[JOINT]
    assert curve.labels == 2
    assert curve.found == [2, 0]
    assert curve.false[0] < curve.contacts[0]
    assert curve.delays_s[0] == pytest.approx([0.1, 0.1], abs=0.011)


def test_nothing_counts_after_the_first_reaction_if_so_asked(
    recording: Path, tmp_path: Path
) -> None:
    snapshot, *states = read_log(recording)
    (touched, _), *_ = noticed(recording, "contact")
    yielding = [
        msgspec.structs.replace(state, mode="admittance") if state.tick > touched.tick else state
        for state in states
    ]
    path = written(tmp_path / "made.mcap", [snapshot, *yielding])
    answer = ask(path, Question(until_reaction=True))
    assert len(answer.contacts) == 1
    assert answer.reaction_s == pytest.approx(answer.contacts[0].time_s + 0.01, abs=1e-6)
    assert answer.watched_s < ask(path, Question()).watched_s


@pytest.mark.parametrize("version", FORMATS)
def test_levels_are_swept_in_recordings_of_each_format(version: int) -> None:
    answer = ask(FORMATS[version], Question(levels={JOINT: (0.1, 5.0)}))
    assert not answer.failed
    assert answer.shares_known == (version != 4)  # which learned without a record of it
    replayed = ask(FORMATS[version], Question(changes=(("estimator.gain", "20"),)))
    assert ("--fresh begins without" in replayed.failed) == (version < SAME_ESTIMATOR)
    assert not ask(FORMATS[version], Question(fresh=True)).failed


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("bus.channel", "can1", "=can1: has no effect: a replay uses only estimator"),
        ("admittance.quiet_s", "0.2", "has no effect"),
        ("estimator.gian", "3", "no setting 'gian'; there are: residual, beside, gain"),
        ("joints.LElbow.half_gap", "3", "no setting 'LElbow'; there are: joint"),
        ("joints.joint.half_gap.x", "3", "no setting 'x'; there is nothing below"),
        ("estimator.gain", "-3", "Expected `float` > 0.0"),
        ("estimator.gain", "[", "is not valid YAML"),
        ("joints.joint.name", "other", "names of joints cannot be changed"),
    ],
)
def test_unknown_or_invalid_settings_are_refused(path: str, value: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=r"^--set") as caught:
        changed_configuration(snapshot_of(FORMATS[4]), [(path, value)])
    assert said in str(caught.value)


def test_a_setting_changes_the_field_at_its_path() -> None:
    changes = [("joints.joint.friction.motor_coulomb", "0.25"), ("estimator.learning", "false"),
               ("estimator.gain", "2e1")]  # fmt: skip
    found = changed_configuration(snapshot_of(FORMATS[4]), changes)
    assert (found.joints[0].friction.motor_coulomb, found.estimator.learning) == (0.25, False)
    assert found.estimator.gain == 20.0


# --- the command ----------------------------------------------------------------------------------


def whatif(*arguments: object) -> Any:
    return CliRunner().invoke(main, ["whatif", *map(str, arguments)])


def test_the_command_prints_and_draws_the_answer(recording: Path, tmp_path: Path) -> None:
    page, labels = tmp_path / "a.html", tmp_path / "labels.csv"
    assert whatif(recording, "--propose-labels", labels).exit_code == 0
    assert labels.read_text().startswith("file,start_s,end_s,joint\nmade.mcap,")
    answer = whatif(recording, "--threshold", "joint=0.2:3:0.2", "--labels", labels, "-o", page)
    assert answer.exit_code == 0, answer.output
    assert "<- chosen" in answer.output
    assert "labelled touches" in answer.output
    assert "default-src 'none'" in page.read_text()
    reported = json.loads(whatif(recording, "--threshold", "joint=0.2:3:0.2", "--json").stdout)
    assert [point["level"] for point in reported["curves"][0]["points"]] == pytest.approx(
        np.arange(0.2, 3.01, 0.2)
    )


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["--threshold", "joint=1:0:0.1"], 2, "must be JOINT=LOW:HIGH:STEP"),
        (["--threshold", "joint=0:1:0.1"], 2, "above 0"),
        (["--threshold", "joint=nan"], 2, "must be JOINT=LOW:HIGH:STEP"),
        (["--threshold", "joint=1:2"], 2, "must be JOINT=LOW:HIGH:STEP"),
        (["--threshold", "=1"], 2, "must be JOINT=LOW:HIGH:STEP"),
        (["--threshold", "joint=1:9:1e-9"], 2, "at most 2000 levels"),
        (["--threshold", "joint=1", "--threshold", "joint=2"], 2, "names a joint twice"),
        (["--collision", "joint=0"], 2, "--collision joint=0: must be JOINT"),
        (["--collision", "elbow=1"], 1, "has no joint 'elbow'; there are: joint"),
        (["--set", "payload=cup"], 1, "--set payload=cup: there is no such name"),
        (["--threshold", "LElbow=1,2"], 1, "has no joint 'LElbow'; there are: joint"),
        (["--set", "gain"], 78, "must be PATH=VALUE"),
        (["--set", "identified=/nonexistent"], 78, "cannot read /nonexistent"),
        (["--labels", "/nonexistent"], 65, "cannot read /nonexistent"),
        (["-o", "a.pdf"], 65, "must end in .html"),
        (["--per-hour", "nan"], 2, "not in the range"),
    ],
)
def test_wrong_options_are_refused(
    recording: Path, arguments: list[str], status: int, said: str
) -> None:
    answer = whatif(recording, *arguments)
    assert answer.exit_code == status
    assert said in answer.stderr


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no column start_s, end_s, joint"),
        ("start_s,end_s,joint\n", "it contains no labels"),
        ("start_s,end_s,joint\n1,x,any\n", ":2: end_s is 'x': must be seconds"),
        ("start_s,end_s,joint\n2,1,any\n", ":2: start_s 2 is not before end_s 1"),
        ("start_s,end_s,joint\n1,2,\n", ":2: joint is empty"),
        ("file,start_s,end_s,joint\nother.mcap,1,2,any\n", "its labels are for other files"),
        ("start_s,end_s,joint\n1,2,elbow\n", "has no joint 'elbow'"),
        ("start_s,end_s,joint\n1\n", ":2: end_s is '': must be seconds"),
        ("start_s,end_s,joint\n1e9,2e9,any\n", "has a label from 1e+09 s on, but lasts only 23."),
    ],
)
def test_wrong_labels_are_refused(recording: Path, tmp_path: Path, text: str, said: str) -> None:
    labels = tmp_path / "labels.csv"
    labels.write_text(text)
    answer = whatif(recording, "--labels", labels)
    assert answer.exit_code != 0
    assert said in answer.stderr


# --- many recordings ------------------------------------------------------------------------------


@pytest.fixture
def folder(recording: Path, tmp_path: Path) -> Path:
    """Three recordings, of which one is no recording and one breaks off."""
    inside = tmp_path / "recordings" / "inside"
    inside.mkdir(parents=True)
    whole = recording.read_bytes()
    (inside / "whole.mcap").write_bytes(whole)
    (inside.parent / "cut.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    (inside.parent / "foreign.mcap").write_bytes(b"PK\x03\x04")
    return inside.parent


def test_a_broken_recording_is_named_and_the_rest_goes_on(folder: Path) -> None:
    answer = whatif(folder, "--threshold", "joint=1.0", "--json")
    assert answer.exit_code == 1
    reported = json.loads(answer.stdout)
    expected = {"recordings": ["cut.mcap", "whole.mcap"], "failed": ["foreign.mcap"]}
    for key, names in (expected | {"broken": ["cut.mcap"]}).items():
        assert [Path(one["file"]).name for one in reported[key]] == names
    assert "foreign.mcap is not an MCAP file" in answer.stderr
    assert "cut.mcap ends in the middle" in answer.stderr


def test_a_copy_of_a_broken_recording_is_named_by_its_own_name(folder: Path) -> None:
    whatif(folder / "cut.mcap", "--threshold", "joint=1.0")
    copy = (folder / "cut.mcap").rename(folder / "copy.mcap")
    for level in ("joint=1.0", "joint=2.0"):  # its answer is kept, or its columns are
        answer = whatif(copy, "--threshold", level)
        assert answer.stderr.startswith(f"contactd: {copy} ends in the middle: ")


def test_a_kept_answer_is_not_computed_again(
    recording: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    question = Question(levels={JOINT: (1.0,)})
    first = kept_answer(question, LabelledRecording(str(recording)))

    def ask_again(*_: object) -> Answer:
        raise AssertionError("asked again")

    monkeypatch.setattr("programs.recordings.many.ask", ask_again)
    assert kept_answer(question, LabelledRecording(str(recording))) == first
    with pytest.raises(AssertionError, match="asked again"):
        kept_answer(Question(levels={JOINT: (1.1,)}), LabelledRecording(str(recording)))


def test_a_damaged_kept_answer_is_computed_again(recording: Path, cache: Path) -> None:
    question = Question(levels={JOINT: (1.0,)})
    first = kept_answer(question, LabelledRecording(str(recording)))
    for kept in (cache / "contactd" / "answers").iterdir():
        kept.write_bytes(b"{")
    assert kept_answer(question, LabelledRecording(str(recording))) == first


def file_in_place_of_folder(columns: Path) -> None:
    shutil.rmtree(columns.parent)
    columns.parent.write_bytes(b"")


DAMAGES: dict[str, Callable[[Path], object]] = {
    "column cut": lambda columns: (columns / "residual").write_bytes(b"12345678"),
    "column missing": lambda columns: (columns / "threshold").unlink(),
    "header cut": lambda columns: (columns / "header.json").write_bytes(b"{"),
    "all missing": shutil.rmtree,
    "no folder": file_in_place_of_folder,
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_columns_are_read_anew(
    recording: Path, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damage: str
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    question = Question(levels={JOINT: (1.0, 2.0)})
    first = ask(recording, question)
    assert not first.failed
    (columns,) = (cache / "contactd" / "columns").iterdir()
    DAMAGES[damage](columns)
    assert ask(recording, question) == first
    assert not list(tmp_path.glob("contactd-columns-*"))


def test_a_kept_answer_is_printed_byte_for_byte_alike(recording: Path) -> None:
    asked = (recording, "--threshold", "joint=1:2:0.1", "--json")
    assert whatif(*asked).stdout == whatif(*asked).stdout


def test_the_time_of_lost_states_does_not_count_as_watched(recording: Path, tmp_path: Path) -> None:
    def later(state: State) -> State:
        return msgspec.structs.replace(
            state, tick=state.tick + 1_000_000, time_s=state.time_s + 1e4
        )

    snapshot, *states = list(read_log(recording))
    half = len(states) // 2
    after = [later(state) for state in states[half:] if isinstance(state, State)]
    path = written(tmp_path / "hours.mcap", [snapshot, *states[:half], *after])
    answer, whole = (ask(one, Question()) for one in (path, recording))
    assert answer.duration_s > 1e4
    assert answer.watched_s == pytest.approx(whole.watched_s)
    replayed = ask(path, Question(changes=(("estimator.debounce", "1"),)))
    assert replayed.skipped_s == pytest.approx(0.01 * len(after))
    assert f"{replayed.skipped_s:.1f} s after lost states are left out" in (
        whatif(path, "--set", "estimator.debounce=1").output
    )
    nothing = ask(written(tmp_path / "none.mcap", [snapshot, *after]), Question(fresh=False,
                  changes=(("estimator.debounce", "1"),)))  # fmt: skip
    assert "has no state that follows a snapshot; --fresh begins without" in nothing.failed


def answered_anew(folder: Path, cache: Path, question: Question, **by: Any) -> None:
    """Comparison of answers by workers, with no answer kept, with those of this process."""
    asked = [LabelledRecording(str(path)) for path in sorted(folder.rglob("*.mcap"))]

    def reported(found: Iterator[Answer]) -> list[tuple[str, bool, int]]:
        return sorted((Path(a.file).name, bool(a.failed), len(a.contacts)) for a in found)

    alone = reported(answers(question, asked))
    for kept in (cache / "contactd" / "answers").iterdir():
        kept.unlink()
    assert reported(answers(question, asked, **by)) == alone
    assert len(alone) == 3


def test_workers_give_the_same_answers(folder: Path, cache: Path) -> None:
    answered_anew(folder, cache, Question(changes=(("estimator.gain", "20"),)), workers=2)


def test_a_dask_cluster_gives_the_same_answers(folder: Path, cache: Path) -> None:
    """Two workers on this machine."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        question = Question(levels={JOINT: (0.5, 1.0)})
        answered_anew(folder, cache, question, scheduler=cluster.scheduler_address)
        assert len(list((cache / "contactd" / "answers").iterdir())) == 2  # by the workers


def test_a_scheduler_that_cannot_be_reached_is_reported(recording: Path) -> None:
    pytest.importorskip("distributed")
    answer = whatif(recording, "--scheduler", "here")
    assert answer.stderr == "contactd: --scheduler here: must be like tcp://127.0.0.1:8786\n"
    answer = whatif(recording, "--scheduler", "tcp://127.0.0.1:9")
    assert answer.exit_code == 65
    assert "--scheduler tcp://127.0.0.1:9: cannot be reached" in answer.stderr


def test_the_largest_force_at_the_tool_as_recorded_and_by_other_settings(recording: Path) -> None:
    states = [one for one in read_log(recording) if isinstance(one, State)]
    most = max(float(np.linalg.norm(one.wrench.force)) for one in states if one.wrench)
    assert most > 1.0
    same = ask(recording, Question())
    assert (same.recorded_N, same.force_N) == pytest.approx((most, most))
    other = ask(recording, Question(changes=(("estimator.gain", "15"),)))
    assert other.recorded_N == pytest.approx(most)
    assert other.force_N != pytest.approx(most, rel=1e-6)
    assert f"up to {most:.0f} N at the tool as recorded" in whatif(recording).output
