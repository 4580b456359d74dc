"""Columns: arrays with the values of States and of estimates."""

from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import Any

import msgspec
import numpy as np
import pytest

from bench.rigs.lockstep import Rig, lockstep_rig
from daemon.protocol.state import State
from daemon.tick.telemetry import estimated
from estimator.estimate import Estimate, EstimateRows, Flag
from programs.clients.columns import Columns, Layout, first_difference

STRANGE_VALUES = {
    "link_velocity": lambda old: [*old[:-1], np.nextafter(old[-1], 1.0)],
    "motor_estimate": lambda old: [*old[:-1], np.nextafter(old[-1], 9.0)],
    "phi": lambda old: [old[0] + 1e-9, *old[1:]],
    "phi_sigma": lambda old: [old[0] + 1e-9, *old[1:]],
    "motor_torque": lambda old: [old[0] + 1e-9, *old[1:]],
    "residual": lambda old: [old[0] + 1e-9, *old[1:]],
    "threshold": lambda old: [old[0] + 1e-9, *old[1:]],
    "thresholded": lambda old: [old[0] + 1e-9, *old[1:]],
    "side": lambda old: ["unknown" if old[0] != "unknown" else "gap", *old[1:]],
    "touched_link": lambda _: "a link of another arm",
    "beside": lambda old: {name: [values[0] + 1e-9, *values[1:]] for name, values in old.items()},
    "flags": lambda _: ["bridged", "late"],  # not in the order in which State says them
}


@pytest.fixture(scope="module")
def reported() -> tuple[Layout, list[State], list[Estimate]]:
    """Thirty ticks of Romeo's arm with a hand on it, from the moment it was switched on."""
    states, estimates = [], []
    with lockstep_rig() as rig:
        rig.arm.external_torque[0] = 6.0

        def each(rig: Rig = rig) -> None:
            states.append(rig.state())
            estimates.append(rig.estimate)

        rig.run(0.1)
        rig.run(0.3, each)
        c = rig.robot.configuration
    return _layout_of(c.joint_names, estimates[0]), states, estimates


def _layout_of(joints: list[str], estimate: Estimate) -> Layout:
    return Layout(tuple(joints), tuple(estimate.beside))


def filled(layout: Layout, estimates: list[Estimate]) -> Columns:
    def rows(name: str) -> Any:
        return np.array([getattr(estimate, name) for estimate in estimates])

    vectors = ("q", "q_dot", "theta", "phi", "phi_sigma", "tau_M", "threshold", "thresholded")
    vectors += ("level_share", "uncorrected")
    links = {name: link for link, name in enumerate(layout.joints)} | {"": -1}
    made = EstimateRows(
        **{name: rows(name) for name in vectors},
        side=rows("side"),
        residual=rows("residual"),
        beside={name: np.array([e.beside[name] for e in estimates]) for name in layout.beside},
        touched_link=np.array([links[e.touched_link] for e in estimates]),
        flags=np.array([int(e.flags) for e in estimates]),
        wrench=rows("wrench"),
    )
    return layout.replayed(made)


def test_recorded_and_replayed_are_the_same_columns(
    reported: tuple[Layout, list[State], list[Estimate]],
) -> None:
    layout, states, estimates = reported
    recorded, replayed = layout.recorded(states), filled(layout, estimates)
    assert recorded.keys() == replayed.keys()
    assert {name.split()[0] for name in recorded} == estimated(estimates[0]).keys()
    assert {name: x.shape for name, x in recorded.items()} == {
        name: x.shape for name, x in replayed.items()
    }
    assert first_difference(recorded, replayed) is None
    assert any(state.touched_link for state in states)
    assert layout.beside


def test_columns_have_the_words_of_the_state(
    reported: tuple[Layout, list[State], list[Estimate]],
) -> None:
    layout, states, estimates = reported
    flagged = [msgspec.structs.replace(estimates[0], flags=flag) for flag in map(Flag, range(64))]
    for estimate, columns, row in _rows([*estimates, *flagged], layout):
        said = {name: layout.in_words(columns, name, row) for name in estimated(estimate)}
        assert said == estimated(estimate)
    assert estimated(estimates[-1])["side"] == states[-1].side


def _rows(estimates: list[Estimate], layout: Layout) -> Iterator[tuple[Estimate, Columns, int]]:
    columns = filled(layout, estimates)
    return ((estimate, columns, row) for row, estimate in enumerate(estimates))


def test_samples_are_the_states_with_nan_where_there_is_none(
    reported: tuple[Layout, list[State], list[Estimate]],
) -> None:
    layout, states, _ = reported
    states = list(states)
    states[3] = msgspec.structs.replace(states[3], motor_position=None)
    samples = layout.samples(states)
    assert np.isnan(samples.motor_position[3]).all()
    for field in fields(samples):
        column = getattr(samples, field.name)
        for row, state in enumerate(states):
            value = getattr(state, field.name)
            assert value is None or column[row].tolist() == value, (field.name, row)


@pytest.mark.parametrize("field", list(STRANGE_VALUES))
def test_any_field_that_differs_is_named_with_its_row(
    reported: tuple[Layout, list[State], list[Estimate]], field: str
) -> None:
    layout, states, estimates = reported
    replayed = filled(layout, estimates)
    changed = list(states)
    for row in (20, 7):
        value = STRANGE_VALUES[field](getattr(states[row], field))
        changed[row] = msgspec.structs.replace(states[row], **{field: value})
    assert first_difference(layout.recorded(changed), replayed) == (7, field)


@pytest.mark.parametrize(
    ("phi", "flags", "first"),
    [(7, 20, (7, "phi")), (20, 7, (7, "flags")), (7, 7, (7, "phi"))],
    ids=["first column", "last column", "one row"],
)
def test_the_earliest_row_comes_before_the_order_of_columns(
    reported: tuple[Layout, list[State], list[Estimate]],
    phi: int,
    flags: int,
    first: tuple[int, str],
) -> None:
    layout, states, estimates = reported
    recorded, replayed = layout.recorded(states), filled(layout, estimates)
    recorded["phi"][phi, 2] += 1e-9
    recorded["flags"][flags] = 1
    assert first_difference(recorded, replayed) == first


@pytest.mark.parametrize(
    "change",
    [
        lambda beside: {},
        lambda beside: {**beside, "another": next(iter(beside.values()))},
        lambda beside: {name: values[:-1] for name, values in beside.items()},
        lambda beside: {name: [*values, 0.0] for name, values in beside.items()},
    ],
    ids=["none", "one more", "too short", "too long"],
)
def test_residuals_beside_of_another_shape_differ(
    reported: tuple[Layout, list[State], list[Estimate]], change: Callable[[object], object]
) -> None:
    layout, states, estimates = reported
    changed = list(states)
    changed[5] = msgspec.structs.replace(states[5], beside=change(states[5].beside))
    found = first_difference(layout.recorded(changed), filled(layout, estimates))
    assert found == (5, "beside")
