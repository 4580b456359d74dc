"""Behaviour oracle: the States of a scripted session in lockstep, compared with earlier ones.

Each make of drive goes through 20 s: enable, arm, start, a push that is yielded to, the quiet time,
a blow, a drive's fault, reset, a second start, stop, disable. One file per robot, one State per
line, without `timing`, which is the only part that differs between two runs. A change that is to
leave behaviour alone keeps the bytes:

    python -m bench.oracle build/before            # on the commit before
    python -m bench.oracle build/after --against build/before

Events count by what they say, so a change of words is a difference, too.
"""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

import click
import msgspec

from bench.rigs.lockstep import DESK_ARM, ROMEO, Rig, lockstep_rig
from daemon.modes.table import Event
from simulator.hand_script import AnyAct, Guide, Push, Release

# Seconds after the arm first moved, a little after it was enabled.
HANDS: dict[Path, tuple[AnyAct, ...]] = {
    ROMEO: (
        Push(at_s=2.5, joint="LShoulderPitch", torque=-2.5, duration_s=0.4, shape="ramp"),
        Guide(at_s=2.9, to={"LShoulderPitch": 0.6, "LElbowYaw": -0.8}, speed=0.25),
        Release(at_s=5.0),
        Push(at_s=10.0, joint="LElbowRoll", torque=8.0, duration_s=0.3),
    ),
    DESK_ARM: (
        Push(at_s=2.5, joint="column", torque=2.0, duration_s=0.6, shape="ramp"),
        Guide(at_s=3.1, to={"column": 0.5, "swing": -0.3}, speed=0.3),
        Release(at_s=5.0),
        Push(at_s=10.0, joint="swing", torque=5.0, duration_s=0.3),
    ),
}
OVER_CURRENT = 0x2310
AFTER_THE_FAULT = (
    (Event.RESET, 0.5), (Event.ENABLE, 1.0), (Event.START, 2.5), (Event.STOP, 0.5),
    (Event.DISABLE, 0.5),
)  # fmt: skip


def session(rig: Rig) -> Iterator[bytes]:
    """20 s, a line per tick."""

    def during(seconds: float) -> Iterator[bytes]:
        for _ in range(round(seconds / rig.robot.configuration.period_s)):
            rig.step()
            state = msgspec.to_builtins(rig.state())
            del state["timing"]
            yield msgspec.json.encode(state)

    def asked(event: Event) -> None:
        rig.tick.controller.request(event, "the oracle", rig.time_s)

    yield from during(0.1)
    asked(Event.ENABLE)
    yield from during(0.6)
    rig.permit("the oracle")
    asked(Event.START)
    yield from during(13.3)
    rig.arm.drives[1].fault(OVER_CURRENT, "over-current")
    yield from during(1.0)
    for event, seconds in AFTER_THE_FAULT:
        asked(event)
        yield from during(seconds)


def first_difference(before: list[bytes], after: list[bytes]) -> str:
    """First difference between the States, in words; empty if there is none."""
    for number, (old, new) in enumerate(zip(before, after, strict=False), 1):
        if old == new:
            continue
        a, b = json.loads(old), json.loads(new)
        fields = [name for name in {**a, **b} if a.get(name) != b.get(name)]
        return f"line {number}: {', '.join(fields) or 'the order of the fields'}"
    if len(before) != len(after):
        return f"{len(before)} states before, {len(after)} after"
    return ""


@click.command()
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
@click.option("--against", type=click.Path(exists=True, file_okay=False, path_type=Path))
def main(folder: Path, against: Path | None) -> None:
    """Write the States of both sessions into FOLDER; the status is 1 if they differ."""
    folder.mkdir(parents=True, exist_ok=True)
    same = True
    for robot, hand in HANDS.items():
        with lockstep_rig(robot, hand=hand) as rig:
            lines = list(session(rig))
        text = b"\n".join(lines) + b"\n"
        modes = dict.fromkeys(json.loads(line)["mode"] for line in lines)
        file = folder / f"{robot.name}.jsonl"
        file.write_bytes(text)
        digest = hashlib.sha256(text).hexdigest()
        click.echo(f"{robot.name}: {len(lines)} states, {digest[:16]}, {', '.join(modes)}")
        if against is not None:
            before = (against / file.name).read_bytes().splitlines()
            where = first_difference(before, lines)
            same = same and not where
            click.echo(f"  {f'differs at {where}' if where else 'identical'}")
    raise SystemExit(0 if same else 1)


if __name__ == "__main__":
    main()
