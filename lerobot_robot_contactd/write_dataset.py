"""Writer of a LeRobot dataset from JSON lines on standard input.

    contactd export --lerobot DIR RECORDING.mcap ...

runs it in LeRobot's environment. The first line has `joints`, `fps`, `task` and `cameras`: for each
camera, one video file per episode, which starts with it. Each further line is a frame: `episode`,
`time_s` within it, `observation` and `action`, lists in the order of the robot's features.
"""

import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

KINDS = ("pos", "vel", "torque", "level")


class Video:
    """Video file, read sequentially; the picture at a time is the last one that had begun."""

    def __init__(self, path: str) -> None:
        self._file = cv2.VideoCapture(path)
        ok, picture = self._file.read()
        if not ok:
            sys.exit(f"{path}: not a readable video")
        self.fps = self._file.get(cv2.CAP_PROP_FPS)
        self._number, self._picture = 0, picture

    def at(self, time_s: float) -> np.ndarray:
        """RGB picture (height, width, 3) at a time [s] not before the previous one. After the end
        of the video the last picture is repeated."""
        while self._number + 1 <= time_s * self.fps + 1e-6:
            ok, picture = self._file.read()
            if not ok:
                break
            self._number, self._picture = self._number + 1, picture
        return np.ascontiguousarray(self._picture[:, :, ::-1])


def features(joints: list[str], cameras: dict[str, Video]) -> dict[str, dict[str, Any]]:
    """Features of a dataset, as `lerobot-record` derives them from the robot."""
    names = [f"{joint}.{kind}" for kind in KINDS for joint in joints] + ["contact", "mode"]
    actions = [f"{joint}.pos" for joint in joints]
    images = {
        f"observation.images.{name}": {
            "dtype": "video",
            "shape": video.at(0.0).shape,
            "names": ["height", "width", "channels"],
        }
        for name, video in cameras.items()
    }
    return {
        "observation.state": {"dtype": "float32", "shape": (len(names),), "names": names},
        "action": {"dtype": "float32", "shape": (len(actions),), "names": actions},
        **images,
    }


def main() -> None:
    """Write the dataset to the folder given as the only argument; print its size."""
    root = Path(sys.argv[1])
    head = json.loads(sys.stdin.readline())
    files: dict[str, list[str]] = head["cameras"]
    videos = {name: Video(paths[0]) for name, paths in files.items()}
    dataset = LeRobotDataset.create(
        repo_id=f"local/{root.name}",
        fps=head["fps"],
        features=features(head["joints"], videos),
        robot_type="contactd",
        root=root,
        use_videos=bool(videos),
    )
    episode = None
    for line in sys.stdin:
        frame = json.loads(line)
        if episode not in (None, frame["episode"]):
            dataset.save_episode()
            videos = {name: Video(paths[frame["episode"]]) for name, paths in files.items()}
        episode = frame["episode"]
        pictures = {
            f"observation.images.{name}": video.at(frame["time_s"])
            for name, video in videos.items()
        }
        dataset.add_frame(
            {
                "observation.state": np.array(frame["observation"], dtype=np.float32),
                "action": np.array(frame["action"], dtype=np.float32),
                "task": head["task"],
                **pictures,
            }
        )
    if episode is not None:
        dataset.save_episode()
    dataset.finalize()
    print(f"{dataset.meta.total_episodes} episodes, {dataset.meta.total_frames} frames")


if __name__ == "__main__":
    main()
