"""Sound captures: a tiny data set of each data manager, to be damaged.

Cameras stand on a ring and see 20 points (tests/support/small_captures.py). Optional parts, such as
masks, depth maps, points and distortion, are there so that their readers are reached.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
from support.captures import (
    blender,
    calibrations,
    colmap_per_frame,
    llff,
    metashape,
    nerfies,
    openmvg,
    opensfm,
    panoptic,
    polycam,
    reality_capture,
    record3d,
)
from support.small_captures import (
    CENTER,
    FOCAL,
    HEIGHT,
    WIDTH,
    SmallCapture,
    ring,
    write_colmap,
    write_image,
    write_images,
    write_transforms,
)
from support.small_videos import cameras, write_video

from gsfw.datamanagers.point_file import ply_of
from gsfw.partition.cells import Cell
from gsfw.partition.document import Block, Partition, write_partition
from gsfw.partition.ground import Ground

VIEWS, TIMES = 3, 3
DISTORTION = {"k1": -0.1, "k2": 0.05, "p1": 2e-3, "p2": -3e-3}

Writer = Callable[[Path], str]
"""Writes a data set into a folder; gives the path in it that is read."""


def _points(path: Path, capture: SmallCapture) -> None:
    import torch

    positions = torch.from_numpy(capture.points)
    path.write_bytes(ply_of(positions, torch.from_numpy(capture.colors) / 255))


def _at_root(write: Callable[..., Path], *arguments: object, **settings: object) -> Writer:
    """A writer of a data set that is read from its folder itself."""

    def written(folder: Path) -> str:
        write(folder, *arguments, **settings)
        return "."

    return written


def colmap_binary(folder: Path) -> str:
    """A binary model with a distorted lens, and a mask of one image."""
    capture = ring(VIEWS)
    lens = (*FOCAL, *CENTER, *DISTORTION.values())
    write_colmap(folder / "sparse/0", capture, model="OPENCV", params=lens)
    write_images(folder / "images", capture)
    write_image(folder / "masks" / capture.names[0], mode="L")
    return "."


def colmap_text(folder: Path) -> str:
    """A model as text."""
    write_colmap(folder / "sparse/0", ring(VIEWS), ".txt")
    write_images(folder / "images", ring(VIEWS))
    return "."


def transforms(folder: Path) -> str:
    """With masks, depth maps, times, camera numbers, a split and points."""
    capture = ring(VIEWS)
    settings = [
        {"mask_path": "mask.png", "depth_file_path": f"{n}.npy", "time": n / 2, "camera_index": n}
        for n in range(VIEWS)
    ]
    lists = {"train_filenames": capture.names[1:], "test_filenames": capture.names[:1]}
    write_transforms(
        folder / "transforms.json", capture, settings, ply_file_path="p.ply", **lists, **DISTORTION
    )
    write_images(folder, capture)
    write_image(folder / "mask.png", mode="L")
    for number in range(VIEWS):
        np.save(folder / f"{number}.npy", np.full((HEIGHT, WIDTH), 900, np.uint16))
    _points(folder / "p.ply", capture)
    return "."


def metashape_with_points(folder: Path) -> str:
    """A chunk with a place in the world, a distorted lens, and points."""
    metashape.write(folder, values=metashape.CALIBRATION | metashape.DISTORTION)
    _points(folder / "points.ply", ring(VIEWS))
    return "."


CALIBRATIONS: Mapping[str, Callable[[Path], Path]] = {
    "cameras.json": lambda path: calibrations.write_json(
        path, *(calibrations.entry(number, dist=[0.1, 0.0, 0.0, 0.0]) for number in range(VIEWS))
    ),
    "Calib.toml": partial(calibrations.write_toml, count=VIEWS, distortion=(0.1, 0.0, 0.0, 0.0)),
    "a.qca.txt": calibrations.write_qualisys,
}
"""Writers of calibrations of several cameras by the names of their files."""


def synchronised(file: str, folder: Path) -> str:
    """A calibration, and videos of its cameras."""
    CALIBRATIONS[file](folder / file)
    for name in cameras(VIEWS).names:
        write_video(folder / f"videos/{name}.mp4", TIMES)
    return "."


def blocks(folder: Path) -> str:
    """A partition into two blocks, and the data set beside it."""
    transforms(folder / "data")
    names = tuple(ring(VIEWS).names)
    sides = (Cell(high=(0.0, math.inf)), Cell(low=(0.0, -math.inf)))
    halves = tuple(
        Block(f"block-{n}", cell, 0.1, names[1:], names[:1], 10, 100, 50.0)
        for n, cell in enumerate(sides)
    )
    ground = Ground(np.zeros(3), np.eye(3))
    settings = {"blank_pixels": 0.5}
    made = Partition(
        folder / "data", "transforms", settings, ground, names[:1], "every 8th by name", halves
    )
    (folder / "cut").mkdir()
    # It states where the data set lies, which is not where it will be read.
    path = write_partition(folder / "cut", made)
    path.write_text(path.read_text().replace(str((folder / "data").resolve()), "/nowhere"))
    return "cut"


CAPTURES: Mapping[str, tuple[Writer, ...]] = {
    "colmap": (colmap_binary, colmap_text),
    "transforms": (transforms,),
    "blender": (_at_root(blender.write, times=(0.0, 0.5, 1.0, 0.5)),),
    "llff": (_at_root(llff.write, ring(VIEWS)),),
    "metashape": (metashape_with_points,),
    "reality-capture": (
        _at_root(
            reality_capture.write,
            [
                reality_capture.row(ring(), view, distortion=reality_capture.DISTORTION)
                for view in range(VIEWS)
            ],
        ),
    ),
    "polycam": (_at_root(polycam.write, views=VIEWS),),
    "record3d": (_at_root(record3d.write, views=VIEWS),),
    "opensfm": (_at_root(opensfm.write, opensfm.reconstruction(opensfm.BROWN | opensfm.TERMS)),),
    "openmvg": (
        _at_root(
            openmvg.write,
            openmvg.scene(openmvg.BASE | {"disto_k3": [-0.1, 0.05, 0.0]}, "pinhole_radial_k3"),
        ),
    ),
    "nerfies": (_at_root(nerfies.write, camera={"radial_distortion": [0.01, 0.0, 0.0]}),),
    "neural-3d-video": (
        _at_root(llff.write_folders, cameras(VIEWS), TIMES),
        _at_root(llff.write_videos, cameras(VIEWS), TIMES),
    ),
    "panoptic": (_at_root(panoptic.write),),
    "colmap-per-frame": (_at_root(colmap_per_frame.write, range(2)),),
    "blocks": (blocks,),
    "synchronised-videos": tuple(partial(synchronised, file) for file in CALIBRATIONS),
}
"""Writers of sound data sets by the name of their data manager."""
