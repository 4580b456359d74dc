"""`contactctl gain`: shows, changes or balances the gains K_a.

Balancing gets configuration and URDF from the daemon's snapshot and computes the gains in this
process; the arm's gains change only by the requests that `--apply` sends, one for each joint.
"""
# ruff: noqa: PLC0415 - the arm's model is imported by the functions that need it

import math
from typing import TYPE_CHECKING

import click

from programs.command_line.options import Command, Options, Range
from programs.command_line.sentences import aligned, say
from programs.contactctl.replies import answer, print_json

if TYPE_CHECKING:
    from common.arrays import Vector
    from daemon.config.schema import Configuration
    from daemon.protocol.replies import Status
    from daemon.protocol.state import Snapshot
    from programs.contactctl.balance import Balance


@click.command(cls=Command, context_settings={"ignore_unknown_options": True})  # -0.1 is no option
@click.argument("joint", required=False)
@click.argument("value", type=Range(), required=False)
@click.option("--balance", is_flag=True, help="Propose gains with which all joints yield equally.")
@click.option("--apply", is_flag=True, help="With --balance: apply the proposed gains.")
@click.pass_obj
def gain(
    options: Options, joint: str | None, value: float | None, balance: bool, apply: bool
) -> None:
    """Show or change how softly joints yield: K_a [rad/s per Nm].

    The gain changes over half a second, also while the joint is led. The configuration is not
    changed: it applies again after a restart of the daemon or a `reload`.

    With --balance: gains with which each joint requires the same force at the hand, from levers,
    inertia and thresholds, beside the present ones. Nothing changes without --apply.
    """
    if value is not None and not math.isfinite(value):
        raise click.UsageError(f"{value:g} is not a gain")  # nor is it a number in JSON
    if balance and joint is not None:
        raise click.UsageError("--balance applies to all joints: give no JOINT")
    if apply and not balance:
        raise click.UsageError("--apply requires --balance")
    if balance:
        balance_all(options, apply=apply)
    elif joint is None or value is None:
        show(options, joint)
    else:
        change(options, joint, value)


def show(options: Options, joint: str | None) -> None:
    """Print the gain of a joint, or of all."""
    with options.connect() as client:
        found = client.ask_status()
    gains = _gains(options, found, joint)
    shown = gains if joint is None else {joint: gains[joint]}
    if options.json:
        print_json(shown)
        return
    for name, k in shown.items():
        click.echo(f"{name:16} {k:<5g} rad/s per Nm")


def change(options: Options, joint: str, value: float) -> None:
    """Change the gain of a joint."""
    from daemon.protocol.requests import SetGain

    with options.connect() as client:
        _gains(options, client.ask_status(), joint)
        answer(options, client.ask(SetGain(joint=joint, gain=value)))


def _gains(options: Options, found: "Status", joint: str | None) -> dict[str, float]:
    """Gains by joint; exits with a refusal for an unknown joint."""
    gains = dict(zip(found.joints, found.gain, strict=True))
    if joint is not None and joint not in gains:
        from daemon.protocol.replies import Reply

        reasons = [f"no joint {joint!r}; there are: {', '.join(gains)}"]
        answer(options, Reply(ok=False, message="gain: refused", reasons=reasons))
    return gains


def balance_all(options: Options, *, apply: bool) -> None:
    """Print balanced and present gains; with `apply`, set the balanced ones."""
    with options.connect() as client:
        found = client.ask_status()
        snapshot, _ = client.subscribe()
    rows = _rows(snapshot, found)
    if options.json:
        print_json({"applied": apply, "joints": rows})
    else:
        say(in_words(rows))
    if not apply:
        if not options.json:
            say("nothing has changed: --apply sets the gains until the daemon ends")
        return
    from daemon.protocol.requests import SetGain

    with options.connect() as client:
        for name, row in rows.items():
            reply = client.ask(SetGain(joint=name, gain=row["gain"]))
            if not reply.ok:
                answer(options, reply)  # earlier joints have changed; `gain` shows which
    if not options.json:
        say("changed until the daemon ends; to keep it: `admittance_gain` in config.yaml")


def balance_of(c: "Configuration", urdf: str) -> "Balance":
    """Balance of an arm, over poses within its limits."""
    import numpy as np

    from daemon.config.dynamics import model_of
    from daemon.config.vectors import row, virtual_mass_of
    from programs.contactctl.balance import balanced, levers
    from programs.contactctl.sensitivity_poses import poses_within

    model, poses = model_of(c, urdf), poses_within(c)
    return balanced(
        levers(np.array([model.tool_jacobian(q) for q in poses])),
        row(c, lambda j: j.thresholds.contact),
        row(c, lambda j: j.rotor_inertia) + np.max([model.inertia(q) for q in poses], axis=0),
        virtual_mass_of(c),
    )


def _rows(snapshot: "Snapshot", status: "Status") -> dict[str, dict[str, float]]:
    """Rows by joint: present and balanced gain [rad/s per Nm], shortest and longest usual lever
    [m], forces at the hand [N] that lead the joint with either gain, and the least force that moves
    it from rest against friction, infinite without detection."""
    import numpy as np

    from daemon.config.load import parse_configuration
    from daemon.config.vectors import row
    from programs.contactctl.balance import leading_torque

    c = parse_configuration(snapshot.configuration, "the daemon's", snapshot.identified)
    threshold, found = row(c, lambda j: j.thresholds.contact), balance_of(c, snapshot.urdf)
    now = np.array(status.gain)
    resting = status.sensitivity.resting if status.sensitivity is not None else [None] * len(now)
    before = leading_torque(now, threshold)
    after = leading_torque(found.gain, threshold)
    columns = {
        "gain_now": now,
        "gain": found.gain,
        "lever_shortest_m": found.shortest,
        "lever_longest_m": found.longest,
        "now_least_N": before / found.longest,
        "now_most_N": before / found.shortest,
        "least_N": after / found.longest,
        "most_N": after / found.shortest,
        "at_rest_from_N": np.array([np.inf if level is None else level for level in resting])
        / found.longest,
    }
    return {
        name: {key: _number(column, i) for key, column in columns.items()}
        for i, name in enumerate(c.joint_names)
    }


def _number(column: "Vector", i: int) -> float:
    """Element of a column, rounded to four significant digits."""
    return float(f"{column[i]:.4g}")


def in_words(rows: dict[str, dict[str, float]]) -> str:
    """Table of the balance, a line for each joint, and the ratio of forces before and after."""
    from programs.contactctl.balance import LEADING_RAD_S

    forces = [
        [f"{row[f'{when}least_N']:.1f} to {row[f'{when}most_N']:.1f}" for row in rows.values()]
        for when in ("now_", "")
    ]
    table = [("", "lever [m]", "K_a", "then", "rest", "led", "then")] + [
        (
            name,
            f"{row['lever_shortest_m']:.2f} to {row['lever_longest_m']:.2f}",
            f"{row['gain_now']:.3g}",
            f"{row['gain']:.3g}",
            f"{row['at_rest_from_N']:.1f}" if math.isfinite(row["at_rest_from_N"]) else "-",
            now,
            then,
        )
        for (name, row), now, then in zip(rows.items(), *forces, strict=True)
    ]
    ratios = [
        max(row[f"{when}most_N"] for row in rows.values())
        / min(row[f"{when}least_N"] for row in rows.values())
        for when in ("now_", "")
    ]
    return "\n".join(
        [
            *aligned(table, numbers=True),
            "K_a in rad/s per Nm; then: as proposed.",
            f"Forces at the hand [N]; led: at {LEADING_RAD_S:g} rad/s, 5th to 95th percentile over "
            "500 poses within the limits.",
            "Rest: force that moves a joint from rest, by its level and friction, which no gain "
            "changes; -: without detection, e.g. with its drives off.",
            f"Ratio of largest to smallest force when led: {ratios[0]:.1f} -> {ratios[1]:.1f}",
        ]
    )
