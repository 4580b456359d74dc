"""Loading of a robot: from its files to a checked `Configuration`.

Every error names the file, line, path in the file, value, and what is allowed.
"""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from common.errors import ConfigurationError, ModelError, TrajectoryError
from common.regular_file import read_text
from common.yaml_source import Source, parse_yaml, read_yaml
from daemon.config.checks import cross_checks, identified_checks, least_levels
from daemon.config.convert import convert
from daemon.config.dynamics import model_of
from daemon.config.identified import Identified, applied, identified_keys, identified_text
from daemon.config.problem import Keys, Problem
from daemon.config.schema import Configuration
from daemon.config.shapes import Walls, read_walls
from daemon.config.trajectories import trajectory_of
from daemon.motion.sampled_path import SampledPath
from drivers.makes import USUAL
from estimator.model import Model


@dataclass(frozen=True, slots=True)
class Robot:
    """One arm, as loaded from its folder and checked."""

    path: Path  # of config.yaml
    configuration: Configuration
    text: str  # content of config.yaml
    urdf: str  # text of the URDF
    model: Model  # of its links with the bodies of `configuration`, shared by all that need it
    trajectory: SampledPath | None = None  # of trajectory.file
    walls: Walls | None = None  # of shapes.yaml and surroundings.yaml
    identified: Identified | None = None  # its values are in `configuration` already
    identified_text: str = ""  # of identified.yaml
    by_hand: "Robot | None" = None  # the robot without identified.yaml, if that file exists

    @property
    def folder(self) -> Path:
        """Folder that paths in the configuration are relative to."""
        return self.path.parent

    def place(self) -> Path:
        """Absolute path of config.yaml, for processes in other folders; queries the file system. If
        config.yaml is a symbolic link, it is not resolved: its files are next to the link."""
        return self.folder.resolve() / self.path.name

    def in_words(self, problem: Problem) -> str:
        """A problem with file and line of its value: config.yaml, or identified.yaml where the
        value was identified."""
        path, text = self.path, self.text
        keys = identified_keys(problem.keys, self.configuration, self.identified)
        if keys:
            path, text = self.folder / self.configuration.identified, self.identified_text
        return _located(problem, parse_yaml(text, path), keys or problem.keys)

    def with_port(self, port: int | None) -> "Robot":
        """Copy of the robot on another TCP port; the robot itself if `port` is None."""
        if port is None:
            return self
        bus = msgspec.structs.replace(self.configuration.bus, port=port)
        return replace(self, configuration=msgspec.structs.replace(self.configuration, bus=bus))


def load_robot(path: Path, *, walls: bool = True) -> Robot:
    """Robot from `config.yaml` (or the folder that contains it) and every file it refers to; walls:
    read its shapes and surroundings, too.

    Raises ConfigurationError, with the first error of types or all errors of cross-checks.
    """
    if os.path.isdir(path):  # false also without permission to search its parent
        path = path / "config.yaml"
    source = read_yaml(path)
    configuration = convert(_with_makes(source), Configuration)
    urdf_path = path.parent / configuration.urdf
    try:
        urdf = read_text(urdf_path)
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is not UTF-8 text"
        where = f"{path}:{source.line(['urdf'])}: urdf: {urdf_path}"
        raise ConfigurationError(f"{where} cannot be read: {why}") from error
    model = _model_or_error(configuration, urdf)
    identified = path.parent / configuration.identified
    alone = not os.path.lexists(identified)  # a dangling link is an error, not a missing file
    findings = cross_checks(configuration, urdf, model, path.parent)
    # `thresholds.least` is checked against identified levels, if there are any.
    findings += least_levels(configuration) if alone else ()
    if findings or isinstance(model, ModelError):
        raise ConfigurationError("\n".join(_located(one, source, one.keys) for one in findings))
    try:
        trajectory = trajectory_of(configuration, path.parent)
    except TrajectoryError as error:
        where = f"{path}:{source.line(['trajectory', 'file'])}: trajectory.file"
        raise ConfigurationError(f"{where}: {error}") from error
    found = read_walls(path.parent, urdf, configuration.joint_names) if walls else None
    robot = Robot(path, configuration, source.text, urdf, model, trajectory, found)
    return robot if alone else _with_identified(robot, read_yaml(identified))


def _with_makes(source: Source) -> Source:
    """Source in which every drive profile names its make."""
    drives = source.data.get("drives") if isinstance(source.data, dict) else None
    if not isinstance(drives, dict):
        return source
    named = {
        name: {"make": USUAL} | profile if isinstance(profile, dict) else profile
        for name, profile in drives.items()
    }
    return replace(source, data=source.data | {"drives": named})


def _located(problem: Problem, source: Source, keys: Keys) -> str:
    return f"{source.path}:{source.line(keys)}: {problem.where}: {problem.what}"


def _model_or_error(c: Configuration, urdf: str) -> Model | ModelError:
    """Model of the arm, or its error, which is reported with other problems."""
    try:
        return model_of(c, urdf)
    except ModelError as error:
        return error


def refuse_unreadable(robot: Robot, found: Identified) -> None:
    """Raise ConfigurationError if an identified.yaml with `found` would be refused when it is
    loaded, as the daemon would not start with it."""
    path = robot.folder / robot.configuration.identified
    source = parse_yaml(identified_text(found), path)
    try:
        _with_identified(robot.by_hand or robot, source)
    except ConfigurationError as error:
        raise ConfigurationError(
            f"the identified values are not written, because they are not allowed: {error}"
        ) from error


def _with_identified(robot: Robot, source: Source) -> Robot:
    """Robot whose hand-written values are replaced by those of the identified.yaml in `source`.
    Raises ConfigurationError."""
    text, found = _identified(source, robot.configuration)
    c = applied(robot.configuration, found)
    # Only identified masses change the model.
    same = c.bodies == robot.configuration.bodies
    model = robot.model if same else _model_or_error(c, robot.urdf)
    now = replace(robot, configuration=c, identified=found, identified_text=text, by_hand=robot)
    findings = identified_checks(c, found, robot.urdf, model, robot.folder)
    if findings or isinstance(model, ModelError):
        raise ConfigurationError("\n".join(now.in_words(finding) for finding in findings))
    return replace(now, model=model)


def _identified(source: Source, configuration: Configuration) -> tuple[str, Identified]:
    found = convert(source, Identified)
    for name in found.joints:
        if name not in configuration.joint_names:
            line = source.line(["joints", name])
            known = ", ".join(configuration.joint_names)
            raise ConfigurationError(
                f"{source.path}:{line}: joints: no joint {name}; there are: {known}"
            )
    return source.text, found


def parse_configuration(text: str, name: str, identified: str = "") -> Configuration:
    """Configuration from the text of `config.yaml` and, if there is one, of `identified.yaml`.

    `name` is for messages. Raises ConfigurationError. No cross-checks are made.
    """
    configuration = convert(_with_makes(parse_yaml(text, Path(name))), Configuration)
    if identified:
        found = _identified(parse_yaml(identified, Path(f"{name}, identified")), configuration)[1]
        configuration = applied(configuration, found)
    return configuration
