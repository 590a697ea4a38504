"""The ``blender`` format: transforms_train.json and its siblings (NeRF-synthetic, D-NeRF)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gsfw.core.config import Detection
from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError, DataError
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.frames import (
    Recording,
    missing_images,
    no_points,
    number_cameras,
)
from gsfw.datamanagers.transforms_file import SPLIT_FILES, TransformsFile


@dataclass
class BlenderConfig(CaptureConfig):
    """Settings of the ``blender`` format."""

    eval_split: str = "test"
    """The held-out split of the data set: test or val."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with a transforms_train.json, or such a file itself."""
        folder = _folder(path)
        found = [name for name in SPLIT_FILES.values() if (folder / name).is_file()]
        recognised = SPLIT_FILES["train"] in found
        return Detection(recognised, SPLIT_FILES["train"], ", ".join(found), priority=20)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the files of the splits and the headers of the images."""
        if self.eval_split not in ("test", "val"):
            raise ConfigError(f"datamanager.eval_split={self.eval_split}: expected test or val.")
        folder = _folder(path)
        files = {
            name: TransformsFile.read(folder / file)
            for name, file in SPLIT_FILES.items()
            if (folder / file).is_file()
        }
        if "train" not in files:
            raise DataError(
                f"{folder} contains no {SPLIT_FILES['train']}.", "Give the folder that contains it."
            )
        held = files.get(self.eval_split)
        # Without a split of its own the data set's images are held out by name, as any others.
        frames, missing = files["train"].frames(Split.TRAIN if held else None)
        notes = [f"{files['train'].path}: {len(frames) + len(missing)} frames"]
        notes += files["train"].path_note()
        if held:
            held_frames, held_missing = held.frames(Split.EVAL)
            notes.append(f"{held.path}: {len(held_frames) + len(held_missing)} frames")
            frames, missing = frames + held_frames, missing + held_missing
        else:
            notes.append(f"there is no {SPLIT_FILES[self.eval_split]}")
        notes.extend(missing_images(missing, len(frames) + len(missing), folder))
        points, colors = no_points()
        return Recording(
            name=folder.resolve().name,
            path=folder,
            frames=tuple(number_cameras(frames)),
            points=points,
            point_colors=colors,
            notes=tuple(notes),
            up="z",
            unused_times=tuple(time for file in files.values() for time in file.times()),
        )


def _folder(path: Path) -> Path:
    return path.parent if path.name in SPLIT_FILES.values() else path
