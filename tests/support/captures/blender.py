"""A small capture as NeRF-synthetic is."""

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
