"""`contactd replay LOG.csv`: residuals and contacts of a log that is no recording."""

from dataclasses import asdict
from pathlib import Path

import click
import msgspec

from daemon.config.load import load_robot
from programs.contactd.replay import contact_row, listed
from programs.identify.csv_log import read_csv
from programs.recordings.over_log import OverLog, over_log


def print_log(file: Path, config: Path, *, as_json: bool) -> None:
    """Run the estimator of `config` over a CSV and report. Raises LogError, ConfigurationError."""
    robot = load_robot(config)
    c = robot.configuration
    constants = {joint.name: joint.torque_constant for joint in c.joints}
    log, notes = read_csv(file, c.joint_names, constants)
    made = over_log(log, c, robot.model)
    if as_json:
        report = asdict(made) | {"contacts": made.contacts, "notes": [*notes, *made.notes]}
        report |= {"largest": made.largest.tolist(), "rms": made.rms.tolist()}
        click.echo(msgspec.json.encode(report))
        return
    click.echo("\n".join(lines(file, made, notes)))


def lines(file: Path, made: OverLog, notes: tuple[str, ...]) -> list[str]:
    """Residuals and contacts of the log, in words."""
    report = [f"{file}: {made.duration_s:.2f} s, {made.samples} samples of "
            f"{', '.join(made.joints)}"]  # fmt: skip
    report += [f"  note      {note}" for note in (*notes, *made.notes)]
    rows = zip(made.joints, made.largest.tolist(), made.rms.tolist(), strict=True)
    report += listed("residual", [f"{name:16} largest {most:.2f} Nm, rms {rms:.3f} Nm"
                                for name, most, rms in rows])  # fmt: skip
    report += listed("contacts", [contact_row(k, one) for k, one in enumerate(made.contacts, 1)])
    return report
