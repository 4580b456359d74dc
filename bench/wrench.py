"""Force at the tool, touched link and point of contact, under hands that press on arms.

    python -m bench.wrench [--arms N] [--jobs N] [--seed N] [--friction smooth|dahl|lugre|all]
                           [--json]

Romeo's arm, OpenArm's, and N generated ones of five to seven joints, with Romeo's drives. Their
friction, masses, gears and drives are off as those of `bench.detection`; each was at work for ten
minutes before. In motion, slowly (0.15 of that), at rest, and at rest with the links in a line, so
that the jacobian lacks a direction: a force of 2 to 60 N presses for 0.7 s, at the tool point, up
to 3 cm beside it, on a link's surface, or at the tool and on a link at once. In a free motion every
force that is shown is false.

Errors count from 0.1 s of a press on, along each direction that is called seen, while a force is
shown. A direction can be shown if 20 N along it would pass a contact level, and cannot if 60 N do
not reach a fifth of one. Beside it what others do: pinv(J^T) r. Links that could be decided: the
largest share of which 95 % are right, by one who knows the noise, the shapes, and how hands are
drawn. The default arms and seeds chose nothing, but
Romeo's what a joint that sticks hides, and all of them how strictly a link is decided mostly.
"""

from collections.abc import Sequence
from typing import Any, Final, get_args

import click
import numpy as np

from bench.options import FRICTION, JOBS, command
from bench.report import Target, plain, print_report
from bench.rigs.generated_arms import generate
from bench.study.monte_carlo import spread
from bench.study.world import Law
from bench.study.wrench import FIRST_S, Job, Kind, run
from bench.study.wrench_bound import most_decided

KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
PRESSED: Final = tuple(kind for kind in KINDS if kind != "free")
FIRST_ARM: Final = 22  # generated arms before it chose the constants
LEAST_JOINTS: Final = 5
SHOWN: Final = 3.0  # contact levels at 60 N: one at 20 N
HIDDEN: Final = 0.2
DECIDED_S: Final = 0.5
POINT_N: Final = 10.0
Found = dict[str, Any]


def arms(count: int) -> list[str]:
    """Romeo's, OpenArm's, and generated ones."""
    seeds = (k for k in range(FIRST_ARM, 1000) if len(generate(k).joints) >= LEAST_JOINTS)
    return ["romeo", "openarm", *(str(next(seeds)) for _ in range(count))]


def scores(runs: Sequence[Found]) -> dict[str, Any]:
    """Figures of runs of one kind of motion, by where the hand pressed."""
    found: dict[str, Any] = {}
    for place in ("tool", "beside"):
        ticks = [f for one in runs for f in one["forces"] if f["place"] == place]
        shown = [f for f in ticks if f["acts"]]
        if not shown:
            continue
        error, sigma, seen = (
            np.array([f[name] for f in shown]) for name in ("error", "sigma", "seen")
        )
        size = np.abs(error)[seen]
        whole = np.sqrt(np.sum(error**2 * seen, axis=1))
        naive = np.array([f["naive"] for f in shown])
        found[place] = {
            "ticks": len(ticks),
            "shown": len(shown) / len(ticks),
            "error_N": np.percentile(size, [50, 95]),
            "error_of_all_three_N": np.percentile(whole, [50, 95]),
            "pseudo_inverse_N": np.percentile(naive, [50, 95]),
            "within_bounds": float(np.mean((np.abs(error) <= 1.96 * sigma)[seen])),
            "misfit": np.percentile([f["misfit"] for f in shown], [50, 95]),
        }
    ticks = [f for one in runs for f in one["forces"]]
    shows, called = (np.array([f[name] for f in ticks]).ravel() for name in ("shows", "called"))
    found["called_seen"] = float(np.mean(called[shows > SHOWN]))
    hidden = shows < HIDDEN
    found["called_unseen"] = float(np.mean(~called[hidden])) if hidden.any() else np.nan
    found["hidden_directions"] = int(np.count_nonzero(hidden))
    elsewhere = [f["misfit"] for f in ticks if f["acts"] and f["place"] in ("link", "two")]
    found["elsewhere_misfit_above_2"] = float(np.mean(np.array(elsewhere) > 2.0))
    return found


def links(runs: Sequence[Found]) -> dict[str, float]:
    """Shares of presses whose first, and last, named link is right, or further in or out."""
    named = [
        (names[0] - link["row"], names[-1] - link["row"])
        for one in runs
        for link in one["links"]
        if len(names := link["named"][link["named"] >= 0])
    ]
    first, last = np.array(named).T
    pressed = [link for one in runs for link in one["links"] if link["touches"]]
    touched = [link["touches"] for link in pressed]
    right, sure, right_evenly, sure_evenly = np.array([link["bound"] for link in pressed]).T
    decided = [next((f for f in press if f["decided"]), None) for press in touched]
    soon = np.array([bool(f and f["after_s"] <= DECIDED_S) for f in decided])
    early = np.array(
        [f["first"] for f, is_soon in zip(decided, soon, strict=True) if f and is_soon]
    )
    furthest = np.array([link["n"] - 1 - link["row"] for link in pressed])[soon]
    further_in = early[early < furthest] == 0
    ticks = np.array([f["first"] for press in touched for f in press if f["decided"]])
    return {
        "decided": len(early) / len(touched),
        "decided_right": float(np.mean(early == 0)),
        "decided_off_by_more_than_one": float(np.mean(np.abs(early) > 1)),
        "could_be_decided": most_decided(right, sure),
        "could_be_by_even_odds": most_decided(right_evenly, sure_evenly),
        "not_the_last_right": float(np.mean(further_in)) if len(further_in) else np.nan,
        "decided_ticks_right": float(np.mean(ticks == 0)),
        "at_first_a_true_at_least": float(np.mean([press[0]["least"] <= 0 for press in touched])),
        "in_the_end_most_likely_right": float(
            np.mean([press[-1]["first"] == 0 for press in touched])
        ),
        "presses": len(named),
        "first_right": float(np.mean(first == 0)),
        "first_further_out": float(np.mean(first > 0)),
        "last_right": float(np.mean(last == 0)),
        "last_further_out": float(np.mean(last > 0)),
    }


def points(runs: Sequence[Found]) -> dict[str, Any]:
    """Figures of the point of contact, of presses that are strong enough for one."""
    said = [
        f
        for one in runs
        for link in one["links"]
        if link["size"] >= POINT_N
        for f in link["touches"]
        if f["after_s"] > FIRST_S
    ]
    given = [f for f in said if f["placed"]]
    error, doubt = np.array([(f["error"], f["doubt"]) for f in given]).T
    return {
        "ticks": len(said),
        "given": len(given) / len(said),
        "error_m": np.percentile(error, [50, 95]),
        "within_doubt": float(np.mean(error <= doubt)),
    }


def targets(
    by_kind: dict[str, Found], named: dict[str, float], placed: dict[str, Any]
) -> list[Target]:
    """Targets of the project that these figures answer."""
    rows = []
    for kind, found in by_kind.items():
        still = kind in ("rest", "stretched")
        for place in ("tool", "beside"):
            one = found[place]
            of = f"{place}, {kind}"
            middle, most = one["error_N"]
            rows += [
                Target(f"median error of a seen direction, {of}", middle, 1.5, "N"),
                Target(f"p95, {of}", most, 8 if still else 4, "N"),
                Target(f"within the stated 95 %, {of}", one["within_bounds"], 0.93, "", "higher"),
                Target(f"and not more than, {of}", one["within_bounds"], 0.98),
            ]
        rows.append(Target(f"seen of what can be, {kind}", found["called_seen"], 0.9, "", "higher"))
    hidden = np.nanmin([found["called_unseen"] for found in by_kind.values()])
    rows.append(Target("unseen of what cannot be shown", hidden, 1.0, "", "higher"))
    middle, most = placed["error_m"]
    true = named["at_first_a_true_at_least"]
    off = named["decided_off_by_more_than_one"]
    return [
        *rows,
        Target("first name of the link is a true `at least`", true, 0.9, "", "higher"),
        Target("link decided within 0.5 s", named["decided"], 0.9, "", "higher"),
        Target("decided link right", named["decided_right"], 0.95, "", "higher"),
        Target("decided link off by more than one", off, 0.01),
        Target("point of 10 N and more given", placed["given"], 0.8, "", "higher"),
        Target("median error of the point", middle, 0.03, "m"),
        Target("p95", most, 0.08, "m"),
    ]


@command(__doc__)
@click.option("--arms", "count", type=click.IntRange(1, 200), default=10, help="Generated ones.")
@JOBS
@click.option("--seed", type=click.IntRange(0, 100_000), default=700)
@FRICTION
def main(count: int, processes: int, seed: int, laws: Sequence[Law], as_json: bool) -> None:
    todo = [
        Job(arm, kind, law, seed + k)
        for k, arm in enumerate(arms(count))
        for law in laws
        for kind in KINDS
    ]
    runs = list(spread(run, todo, processes, "arms"))
    runs.sort(key=lambda one: repr(one["job"]))
    by_kind: dict[str, Found] = {
        kind: scores([one for one in runs if one["job"].kind == kind]) for kind in PRESSED
    }
    free = [one for one in runs if one["job"].kind == "free"]
    minutes = sum(one["free_s"] for one in free) / 60.0
    false = {"minutes": minutes, "forces": sum(one["false"] for one in free)}
    named = links([one for one in runs if one["links"]])
    placed = points([one for one in runs if one["links"]])
    data = {
        "arms": arms(count),
        "laws": list(laws),
        "scores": by_kind,
        "links": named,
        "points": placed,
        "free": false,
    }
    print_report("wrench", seed, targets(by_kind, named, placed), plain(data, 3), as_json=as_json)


if __name__ == "__main__":
    main()
