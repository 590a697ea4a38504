"""A small capture as NeRF-synthetic is."""

import json
from dataclasses import replace

from support.small_captures import HEIGHT, WIDTH, ring, write_image, write_transforms


def write(folder, splits=("train", "test"), times=None, mode="RGBA"):
    """A part of the ring for each split; file paths have no extension, as in NeRF-synthetic."""
    for number, split in enumerate(splits):
        members = [0, 1, 2] if split == "train" else [2 + number]
        part = replace(
            ring(6),
            poses=[ring(6).poses[index] for index in members],
            names=[f"./{split}/r_{index}" for index in members],
        )
        for name in part.names:
            write_image(folder / f"{name}.png", WIDTH, HEIGHT, mode)
        settings = [{"time": times[index]} for index in members] if times else ()
        write_transforms(folder / f"transforms_{split}.json", part, settings)
    return folder


def dnerf(folder, masks=False):
    """A data set as D-NeRF's: one camera that is carried around, other times in each split."""
    write(folder, ("train", "test", "val"), times=[0.0, 0.5, 1.0, 0.25, 0.75, 0.0])
    if masks:
        content = json.loads((folder / "transforms_test.json").read_text())
        content["frames"][0]["motion_mask_path"] = "masks/r_3"
        (folder / "transforms_test.json").write_text(json.dumps(content))
    return folder
