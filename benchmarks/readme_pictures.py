"""The pictures of the README: a film of the moving built-in scene, and stills of both scenes.

    OMP_NUM_THREADS=2 python benchmarks/readme_pictures.py [FOLDER] [RUNS]

trains both built-in scenes into RUNS (a temporary folder when left out; runs that are there are
kept), some minutes each on two cores, renders them with ``gsfw render``, and writes film.webp,
views.jpg and channels.jpg to FOLDER (docs/images when left out).
"""

from __future__ import annotations

import argparse
import math
import shutil
import tempfile
from pathlib import Path

from PIL import Image
from printing import say_size

from gsfw.commands.interface.runs import find_run, restore_run
from gsfw.commands.main import main as gsfw
from gsfw.core.datamanager import Split
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.maths.camera_path import spiral
from gsfw.plugins.registry import installed
from gsfw.rendering.color_maps import UNKNOWN
from gsfw.rendering.key_frames import CameraPath, KeyFrame, write_camera_path
from gsfw.rendering.paths import alike

SIZE = ("datamanager.width=320", "datamanager.height=240")
SCENES = {
    "still": ("method=3dgs", "steps=1000", *SIZE, "datamanager.views=60"),
    "moving": (
        *("method=4dgs", "steps=1500", *SIZE, "datamanager.moving=true"),
        *("datamanager.times=20", "datamanager.views=160"),
    ),
}
"""Settings of each run."""

DARK = (f"background={UNKNOWN},{UNKNOWN},{UNKNOWN}", "width=320", "bars=false")
"""Panels of the film and of the sheet: one background, the grey of pixels without a value."""

SHEET = ("color", "depth", "normals", "contribution", "count", "motion")
"""Channels of the sheet."""

VIEW, FRAME = 2, 2
"""The held-out view, and the frame of 8, that the stills show."""

KEYS, FPS, SECONDS = 16, 20, 5.0
"""Key frames of the film, and its speed and length."""

CLOSER = 1.04
"""Part of the view of the training cameras that the film shows: the scene just fits."""

FILM_BYTES, STILL_BYTES = 2_000_000, 300_000
"""Largest files that a page should load."""


def train(name: str, runs: Path) -> Path:
    """The run of a scene; trained unless it is there."""
    run = runs / name
    if RunFolder(run).latest_checkpoint() is None:
        check(gsfw(["train", *SCENES[name], f"out={run}"]))
    return run


def camera_path(run: Path, file: Path) -> Path:
    """A closed way around the scene, on which time passes to the end and back again."""
    data = restore_run(find_run(str(run), print), installed()).composition.parts.data
    cameras = spiral(alike(data.views(Split.TRAIN).cameras), KEYS)
    to_world = data.scene.world_from_scene.camera(cameras.world_to_camera).inverse()
    fov = math.degrees(
        2 * math.atan(cameras.height / 2 / float(cameras.intrinsics[0, 1, 1]) * CLOSER)
    )
    keys = [
        KeyFrame(pose, fov, time=0.5 - 0.5 * math.cos(2 * math.pi * number / KEYS))
        for number, pose in enumerate(to_world)
    ]
    return write_camera_path(file, CameraPath(tuple(keys), FPS, SECONDS, closed=True))


def film(run: Path, work: Path, out: Path) -> Path:
    """Colour, depth and motion side by side, all around the scene while time passes."""
    path = camera_path(run, work / "film.json")
    render(run, work, f"camera={path}", "channel=color,depth,motion", "video=webp", *DARK)
    return Path(shutil.copy(work / "film.webp", out / "film.webp"))


def stills(run: Path, moving: Path, work: Path, out: Path) -> list[Path]:
    """A held-out view beside its photo, and the channels of one frame."""
    render(run, work, "what=views", "channel=photo,color,error")
    path = camera_path(moving, work / "channels.json")
    render(moving, work, f"camera={path}", "frames=8", f"channel={','.join(SHEET)}", *DARK)
    pictures = {
        "views": Image.open(sorted((work / "views").glob("*.png"))[VIEW]),
        "channels": sheet(Image.open(work / "channels" / f"{FRAME:04d}.png")),
    }
    written = [out / f"{name}.jpg" for name in pictures]
    for file, picture in zip(written, pictures.values(), strict=True):
        picture.convert("RGB").save(file, quality=90, subsampling=0)
    return written


def sheet(row: Image.Image) -> Image.Image:
    """The panels of a picture in two rows."""
    half = row.width // 2
    folded = Image.new("RGB", (half, 2 * row.height))
    for number in range(2):
        panels = row.crop((number * half, 0, (number + 1) * half, row.height))
        folded.paste(panels, (0, number * row.height))
    return folded


def render(run: Path, out: Path, *arguments: str) -> None:
    """Render, and stop where that fails."""
    check(gsfw(["render", str(run), f"out={out}", *arguments]))


def check(code: int) -> None:
    """Stop where a command failed; it has said why."""
    if code:
        raise SystemExit(code)


def main(out: Path, runs: Path) -> None:
    """Train, render, and check the sizes of the files."""
    out.mkdir(parents=True, exist_ok=True)
    still, moving = train("still", runs), train("moving", runs)
    with tempfile.TemporaryDirectory() as folder:
        files = [film(moving, Path(folder), out), *stills(still, moving, Path(folder), out)]
    for file in files:
        say_size(file, FILM_BYTES if file.suffix == ".webp" else STILL_BYTES)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("docs/images"))
    parser.add_argument("runs", nargs="?", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        main(given.folder, given.runs or Path(temporary))
