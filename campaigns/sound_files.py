"""Sound single files that data sets are made of: images, arrays, points, calibrations, videos."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from sound_captures import CALIBRATIONS
from support.small_captures import ring
from support.small_videos import write_video

from gsfw.datamanagers.point_file import ply_of

WIDTH, HEIGHT = 16, 12
IMAGES: Mapping[str, tuple[str, Mapping[str, object]]] = {
    "a.png": ("RGB", {}),
    "alpha.png": ("RGBA", {}),
    "palette.png": ("P", {"transparency": 3}),
    "grey16.png": ("I;16", {}),
    "bits.png": ("1", {}),
    "turned.jpg": (
        "RGB",
        {"exif": b"Exif\0\0MM\0*\0\0\0\x08\0\1\1\x12\0\3\0\0\0\1\0\6\0\0\0\0\0\0"},
    ),
    "cmyk.jpg": ("CMYK", {}),
    "progressive.jpg": ("RGB", {"progressive": True}),
    "a.webp": ("RGBA", {"lossless": True}),
    "lossy.webp": ("RGB", {"quality": 50}),
    "deflated.tif": ("RGB", {"compression": "tiff_deflate"}),
    "float.tif": ("F", {}),
    "grey16.tif": ("I;16", {"compression": "tiff_lzw"}),
    "a.bmp": ("RGB", {}),
}
"""Mode and options of Pillow of an image in each format, and in each kind of pixels."""
MASKS: Mapping[str, tuple[str, Mapping[str, object]]] = {
    "a.png": ("L", {}),
    "a.gif": ("P", {}),
    "a.pgm": ("L", {}),
    "a.tga": ("L", {"compression": "tga_rle"}),
    "a.jp2": ("L", {}),
}

Writer = Callable[[Path], str]
"""Writes a file into a folder; gives its name."""


def _picture(mode: str) -> Image.Image:
    values = (np.arange(WIDTH * HEIGHT * 3) * 7 % 256).astype(np.uint8)
    image = Image.fromarray(values.reshape(HEIGHT, WIDTH, 3))
    if mode == "I;16":
        return Image.fromarray(np.asarray(image.convert("L")).astype(np.uint16) * 200)
    return image.convert(mode)


def _image(name: str, mode: str, options: Mapping[str, object], folder: Path) -> str:
    _picture(mode).save(folder / name, **options)  # type: ignore[arg-type]
    return name


def _array(name: str, values: np.ndarray, folder: Path) -> str:
    if name.endswith(".npz"):
        np.savez_compressed(folder / name, values)
    else:
        np.save(folder / name, values)
    return name


def _points(encoding: str, folder: Path) -> str:
    capture = ring(3)
    whole = ply_of(torch.from_numpy(capture.points), torch.from_numpy(capture.colors) / 255)
    if encoding == "text":
        from plyfile import PlyData

        (folder / "binary").write_bytes(whole)
        elements = PlyData.read(str(folder / "binary")).elements
        PlyData(elements, text=True).write(str(folder / "points.ply"))
        (folder / "binary").unlink()
    else:
        (folder / "points.ply").write_bytes(whole)
    return "points.ply"


def _calibration(name: str, folder: Path) -> str:
    CALIBRATIONS[name](folder / name)
    return name


def _video(name: str, folder: Path) -> str:
    write_video(folder / name, 5, 32, 24)
    return name


def _workload(folder: Path) -> str:
    np.savez(
        folder / "workload.npz",
        means=np.zeros((5, 3)),
        quats=np.ones((5, 4)),
        scales=np.full((5, 3), 0.1),
        opacities=np.full(5, 0.5),
        colors=np.zeros((5, 3)),
        world_to_camera=np.eye(4),
        intrinsics=np.array([[30.0, 0, 16], [0, 30, 12], [0, 0, 1]]),
        width=32,
        height=24,
    )
    return "workload.npz"


FLOATS = np.linspace(0, 1, 60, dtype=np.float32).reshape(3, 4, 5)
FILES: Mapping[str, tuple[Writer, ...]] = {
    "points": (partial(_points, "binary"), partial(_points, "text")),
    "image": tuple(partial(_image, name, *options) for name, options in IMAGES.items()),
    "mask": tuple(partial(_image, name, *options) for name, options in MASKS.items()),
    "array": (
        partial(_array, "a.npy", FLOATS),
        partial(_array, "fortran.npy", np.asfortranarray(FLOATS.astype(np.uint16))),
        partial(_array, "a.npz", FLOATS),
    ),
    "calibration": tuple(partial(_calibration, name) for name in CALIBRATIONS),
    "video": tuple(partial(_video, f"a{suffix}") for suffix in (".mp4", ".mkv", ".avi")),
    "workload": (_workload,),
}
"""Writers of sound files by the name of what reads them."""
