"""Writer of a LeRobot dataset, from lines of JSON on standard input.

    contactd export --lerobot DIR RECORDING.mcap ...

runs it in LeRobot's environment. The first line has `joints`, `fps` and `task`; each other line a
frame: `episode`, `observation` and `action`, lists in the order of the robot's features.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

KINDS = ("pos", "vel", "torque", "level")


def features(joints: list[str]) -> dict[str, dict[str, Any]]:
    """Features of a dataset, as `lerobot-record` makes them of the robot."""
    names = [f"{joint}.{kind}" for kind in KINDS for joint in joints] + ["contact", "mode"]
    actions = [f"{joint}.pos" for joint in joints]
    return {
        "observation.state": {"dtype": "float32", "shape": (len(names),), "names": names},
        "action": {"dtype": "float32", "shape": (len(actions),), "names": actions},
    }


def main() -> None:
    """Write the dataset to the folder that is the one argument; print its size."""
    root = Path(sys.argv[1])
    head = json.loads(sys.stdin.readline())
    dataset = LeRobotDataset.create(
        repo_id=f"local/{root.name}",
        fps=head["fps"],
        features=features(head["joints"]),
        robot_type="contactd",
        root=root,
        use_videos=False,
    )
    episode = None
    for line in sys.stdin:
        frame = json.loads(line)
        if episode not in (None, frame["episode"]):
            dataset.save_episode()
        episode = frame["episode"]
        dataset.add_frame(
            {
                "observation.state": np.array(frame["observation"], dtype=np.float32),
                "action": np.array(frame["action"], dtype=np.float32),
                "task": head["task"],
            }
        )
    if episode is not None:
        dataset.save_episode()
    dataset.finalize()
    print(f"{dataset.meta.total_episodes} episodes, {dataset.meta.total_frames} frames")


if __name__ == "__main__":
    main()
