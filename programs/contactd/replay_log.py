"""`contactd replay LOG.csv`: residuals and contacts of a log of another program."""

from pathlib import Path

import click
import msgspec
import numpy as np

from daemon.config.load import load_robot
from programs.contactd.replay import contact_row, listed
from programs.identify.foreign import foreign_states
from programs.recordings.contents import Contents


def print_log(file: Path, config: Path, *, as_json: bool) -> None:
    """Run the estimator of `config` over a CSV and report. Raises LogError, ConfigurationError."""
    snapshot, states = foreign_states(file, load_robot(config))
    contents = Contents()
    contents.take(snapshot)
    contents.take(states)
    r = np.array([state.residual for state in states])
    largest, rms = np.abs(r).max(axis=0).tolist(), np.sqrt(np.square(r).mean(axis=0)).tolist()
    notes = [event.text for event in contents.events if event.kind == "mode"]
    if as_json:
        report = {
            "joints": contents.joints, "samples": len(states), "duration_s": contents.duration_s,
            "largest": largest, "rms": rms, "contacts": contents.contacts, "notes": notes,
        }  # fmt: skip
        click.echo(msgspec.json.encode(report))
        return
    lines = [f"{file}: {contents.duration_s:.2f} s, {len(states)} samples of "
             f"{', '.join(contents.joints)}"]  # fmt: skip
    lines += [f"  note      {note}" for note in notes]
    rows = zip(contents.joints, largest, rms, strict=True)
    lines += listed("residual", [f"{name:16} largest {most:.2f} Nm, rms {each:.3f} Nm"
                                 for name, most, each in rows])  # fmt: skip
    lines += listed("contacts", [contact_row(k, one) for k, one in enumerate(contents.contacts, 1)])
    click.echo("\n".join(lines))
