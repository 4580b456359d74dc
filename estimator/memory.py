"""Internal state of an estimator as plain lists and back, so that recordings replay
bit-identically.

The state is made of numbers and arrays of the kernel and its parts, by name; a value nested within
a part is listed under its last name.
"""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import numpy as np

from common.errors import ModelError
from estimator.kernel import Kernel
from estimator.link_velocity import SAMPLES

_STATE: dict[str, tuple[str, ...]] = {
    "kernel": ("elapsed_s", "since", "going", "q", "q_dot", "tau_M", "transmitted", "threshold"),
    "alignment": ("count", "interval", "interval_before", "history", "aligned"),
    "interval": ("begin",),
    "motor_position": (
        *("theta", "sigma", "streak", "side", "gap"),
        *("q", "slipped", "slipped_most", "rested_at", "rested_s"),
    ),
    "stiction": ("ends", "held", "unknown"),
    "residual": ("values",),
    "levels": ("begin", "friction", "raised"),
    "detector": ("streak", "waited"),
    # Only with learning:
    "learning": (
        *("covariance", "columns", "shares", "coulomb_left", "viscous_left"),
        *("calm_s", "needed.quiet_s", "needed.loud_s", "still_s", "correction", "unknown"),
        *("needed.squares_s", "needed.moved_s", "needed.peak", "needed.crossing_peak"),
        *("needed.peak_seen", "needed.crossing_seen", "needed.lean", "settled", "needed.passing"),
        *("needed.carried_s", "needed.reach"),
    ),
    "doubt": (
        *("value", "lasted_s", "upwards_owed_s", "downwards_owed_s"),
        *("way", "beyond", "rubs", "placed", "moving"),
        *("low", "high", "cleared_s", "upwards_s", "downwards_s", "met", "away_s"),
        *("near_s", "depth", "margin", "needed_s"),
    ),
}
# Missing in recordings older than the estimate of the force at the tool.
_WRENCH = ("peak", "peak_seen", "quiet_s", "lag", "shown")
# Only with a payload or suspended learning, so that all other memories keep their format.
_CARRIED = ("torques.payload", "adaptation.frozen")

#: Bound of every number: samples of 1e9 are not plausible in any unit.
_LARGEST = 1e12
_RANGES = {
    "kernel.since": (0.0, _LARGEST),
    "kernel.going": (0, 1),
    "kernel.threshold": (0.0, _LARGEST),
    "kernel.frozen": (0, 1),
    "alignment.count": (0, SAMPLES),
    "motor_position.sigma": (0.0, _LARGEST),
    "motor_position.side": (-1, 2),
    "motor_position.gap": (0, 1),
    "stiction.ends": (-1.0, 1.0),
    "levels.begin": (0.0, _LARGEST),
    "levels.friction": (0.0, _LARGEST),
    "levels.raised": (0.0, _LARGEST),
    "learning.still_s": (0.0, _LARGEST),
    "learning.squares_s": (0.0, _LARGEST),
    "learning.moved_s": (1e-6, _LARGEST),
    "learning.carried_s": (0.0, _LARGEST),
    "learning.reach": (1.0, _LARGEST),
    "learning.peak": (0.0, _LARGEST),
    "learning.crossing_peak": (0.0, _LARGEST),
    "learning.peak_seen": (0.0, _LARGEST),
    "learning.crossing_seen": (0.0, _LARGEST),
    "learning.passing": (0.0, _LARGEST),
    "wrench.peak": (0.0, _LARGEST),
    "doubt.value": (0.0, 1.0),
    "doubt.margin": (0.0, _LARGEST),
    "doubt.way": (-1, 1),
    "doubt.beyond": (0, 1),
    "doubt.rubs": (0, 1),
    "doubt.placed": (0, 1),
    "doubt.moving": (0, 1),
}


def dump(kernel: Kernel) -> dict[str, Any]:
    """Copy of the complete state, by part and name; arrays as nested lists."""
    extra = {"wrench"}
    if bool(kernel.adaptation.frozen) or any(np.asarray(kernel.torques.payload).tolist()):
        extra.add("carried")
    return {
        part: {name: np.asarray(getattr(owner, name)).tolist() for name, owner in values}
        for part, values in _parts(kernel, extra)
    }


def load(kernel: Kernel, state: Mapping[str, Any]) -> None:
    """Restore the values of `dump`. Raises ModelError, and changes nothing, if any of them does not
    fit."""
    extra = {"wrench", "carried"} & (state.keys() if isinstance(state, Mapping) else set())
    parts = list(_parts(kernel, extra))
    _check_names("an estimator", state, [part for part, _ in parts])
    read = []
    for part, values in parts:
        _check_names(part, state[part], [name for name, _ in values])
        for name, owner in values:
            old = np.asarray(getattr(owner, name))
            what = f"{'kernel' if part == 'carried' else part}.{name}"
            read.append((owner, name, old, _array_like(old, state[part][name], what)))
    kernel.adaptation.frozen = 0
    kernel.torques.put_on(np.zeros(4))
    for owner, name, old, new in read:
        if old.ndim:
            old[...] = new  # in place: other objects hold views
        else:
            setattr(owner, name, new.item())
    kernel.torques.put_on(np.array(kernel.torques.payload))
    kernel.resume()


def _parts(kernel: Kernel, extra: Collection[str]) -> Iterator[tuple[str, list[tuple[str, Any]]]]:
    """Parts of the memory: name of each, and its values by name with the objects that hold them."""
    for part, names in _STATE.items():
        if part in ("learning", "doubt") and not kernel.learns:
            continue
        yield (
            part,
            [_found(kernel if part == "kernel" else getattr(kernel, part), x) for x in names],
        )
    if "wrench" in extra:
        yield "wrench", [(name, kernel.wrench) for name in _WRENCH]
    if "carried" in extra:
        yield "carried", [_found(kernel, name) for name in _CARRIED]


def _found(part: Any, path: str) -> tuple[str, Any]:
    """Name of a value, and the object within a part that holds it."""
    within, _, name = path.rpartition(".")
    return name, getattr(part, within) if within else part


def _check_names(what: str, given: Mapping[str, Any], names: Any) -> None:
    if not isinstance(given, Mapping):
        raise ModelError(f"memory of {what}: {type(given).__name__}, expected fields")
    if set(given) != set(names):
        raise ModelError(f"memory of {what}: fields {sorted(given)}, expected {sorted(names)}")


def _array_like(old: np.ndarray, values: Any, what: str) -> np.ndarray:
    """Values as an array like `old`. Raises ModelError if they do not fit."""
    try:
        given = np.array(values)
        with np.errstate(invalid="raise"):  # beyond the integers
            new = given.astype(old.dtype)
    except (TypeError, ValueError, ArithmeticError) as error:
        raise ModelError(f"memory of {what}: {error}") from error
    if given.size and given.dtype.kind not in ("if" if old.dtype.kind == "f" else "i"):
        raise ModelError(f"memory of {what}: {given.dtype}, not {old.dtype}")
    if new.shape != old.shape:
        raise ModelError(f"memory of {what}: shape {new.shape}, not {old.shape}")
    lowest, highest = _RANGES.get(what, (-_LARGEST, _LARGEST))
    if not np.all((new >= lowest) & (new <= highest)):  # false for NaN
        raise ModelError(f"memory of {what}: not within {lowest:g} and {highest:g}")
    return new
