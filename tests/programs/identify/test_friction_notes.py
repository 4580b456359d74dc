"""Notes on fits of friction: wide intervals, and gravity that does not fit."""

import math
import re
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from identification.friction_verdict import Verdict
from programs.contactd.contactd import main
from programs.identify.friction_notes import (
    LONGEST_S,
    load_doubts,
    off_scale,
    rotor_doubts,
    wide_intervals,
)

LONGER = re.compile(r"`--seconds\s+(\d+)`\s+narrows")
URDF = "as the URDF's masses may be wrong{}: run `contactd identify masses`, then `friction` again"


def fit(
    joint: str,
    uncertainty: float,
    seconds: float,
    verdict: Verdict = Verdict.GOOD,
    masses_matter: bool = True,
) -> object:
    return SimpleNamespace(
        joint=joint, verdict=verdict, masses_matter=masses_matter,
        uncertainty=uncertainty, seconds_for=lambda width: seconds,
        uncertainty_after=lambda longer: {LONGEST_S: 0.8 * uncertainty}[longer],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("fits", "weighed", "notes"),
    [
        ([fit("a", 0.14, 40.0)], True, ()),
        ([fit("a", 0.1509, 61.0)], True, ()),  # the same, as it is shown
        ([fit("a", 0.9, 40.0, Verdict.BAD_FIT)], True, ()),
        (
            [fit("a", 0.24, 131.0), fit("b", 0.1, 5.0)],
            True,
            ("friction is known to +-12 % at a: `--seconds 140` narrows that to +-7.5 %",),
        ),
        (
            [fit("a", 0.24, 600.0), fit("b", 0.2, 5.0)],
            False,
            (f"friction is known to +-12 % at a, +-10 % at b, {URDF.format('')}; if the URDF is "
             "good enough, `--seconds 600` narrows that to +-7.5 %",),
        ),
        (
            [fit("a", 0.24, 600.0), fit("b", 0.2, 5.0, masses_matter=False)],
            False,
            (f"friction is known to +-12 % at a, +-10 % at b, {URDF.format(' (a)')}; if the URDF "
             "is good enough, `--seconds 600` narrows that to +-7.5 %",),
        ),
        (
            [fit("a", 0.24, 131.0, masses_matter=False)],
            False,
            ("friction is known to +-12 % at a: `--seconds 140` narrows that to +-7.5 %",),
        ),
        (
            [fit("a", 0.5, math.inf), fit("b", 0.2, 131.0), fit("c", 0.25, 601.0)],
            True,
            ("friction is known to +-25 % at a, +-10 % at b, +-12 % at c: `--seconds 140` "
             "narrows that of b to +-7.5 %; `--seconds 600` leaves a +-20 %, c +-10 %: a longer "
             "motion does not reduce errors of masses, of torque constants, of friction that falls "
             "with speed, or of setpoints that change within a period",),
        ),
    ],
)  # fmt: skip
def test_what_would_make_it_narrower(fits, weighed, notes):
    assert wide_intervals(fits, masses_identified=weighed) == notes


def test_what_a_rotor_that_is_not_taken_costs_is_said() -> None:
    doubts = [("a", "steps"), ("b", ""), ("c", "steps"), ("d", "no log")]
    fits = [SimpleNamespace(joint=joint, rotor_doubt=doubt, verdict=Verdict.GOOD)
            for joint, doubt in doubts]  # fmt: skip
    steps, log = rotor_doubts(fits, [0.123, 1.0, 0.05, 0.2])
    assert steps.startswith("B of a, c is rejected: steps. ")
    assert "levels bear 0.12, 0.05 Nm more" in steps
    assert "B of d" in log
    (of_none,) = rotor_doubts(fits[:1], [0.0])  # no rotor in force: twice none is no cost
    assert of_none == "B of a is rejected: steps"


@pytest.mark.parametrize("seconds", [LONGEST_S, LONGEST_S + 1])
def test_what_is_advised_is_what_friction_takes(seconds):
    words = ["identify", "friction", "--seconds", str(seconds), "--config", "nowhere", "--log", "a"]
    said = CliRunner().invoke(main, words).output
    assert ("--seconds" in said) is (seconds > LONGEST_S), said


def test_the_person_of_the_bench_reads_it():
    (note,) = wide_intervals([fit("a", 0.24, 131.0)], masses_identified=True)
    reported = LONGER.search(note.replace("seconds 140", "seconds\n140"))
    assert reported is not None
    assert reported[1] == "140"


@pytest.mark.parametrize(
    ("scale", "off", "verdict", "says"),
    [
        (1.0, 0.0, Verdict.GOOD, None),
        (1.09, 0.4, Verdict.GOOD, None),
        (float("nan"), 0.0, Verdict.GOOD, None),
        (1.25, 1.0, Verdict.GOOD, "masses are wrong: elbow by +25 % (1 Nm)"),
        (0.85, 0.6, Verdict.GOOD, "masses are wrong: elbow by -15 % (0.6 Nm)"),
        (0.85, 0.0, Verdict.GOOD, None),  # of next to nothing
        (1.4, 1.0, Verdict.WRONG_GRAVITY, None),  # its own reason says it
    ],
)
def test_gravity_that_does_not_fit_is_reported(scale, off, verdict, says) -> None:
    fit = SimpleNamespace(joint="elbow", gravity_scale=scale, gravity_off=off, verdict=verdict)
    notes = off_scale([fit])
    assert len(notes) == (says is not None)
    assert all(says in note for note in notes)


@pytest.mark.parametrize(
    ("load", "bound", "verdict", "says"),
    [(None, 0.3, Verdict.GOOD, "cannot be seen at wrist, as the load on the gear changes"),
     (None, 0.05, Verdict.GOOD, None), ((0.1, 0.4), 0.4, Verdict.GOOD, None),
     (None, 0.3, Verdict.BAD_FIT, None)],
)  # fmt: skip
def test_load_friction_that_would_not_show_is_reported(load, bound, verdict, says) -> None:
    fit = SimpleNamespace(joint="wrist", load=load, load_bound=bound, verdict=verdict)
    notes = load_doubts([fit])
    assert len(notes) == (says is not None)
    assert all(says in note for note in notes)
