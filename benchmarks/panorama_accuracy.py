"""Accuracy of the cameras that `gsfw prepare` computes from panoramas of a synthetic room.

    PYTHONPATH=tests python benchmarks/panorama_accuracy.py FOLDER count=6 width=1024

It photographs a walk, prepares it once as panoramas and once with the same views as separate photos
of known focal length, and prints errors after a similarity: of centres in percent of the walk's
extent, and of turns in degrees.
"""

from __future__ import annotations

import shutil
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
from support.panorama_room import Walk

from gsfw.preparation.camera_grouping import CameraRule
from gsfw.preparation.mapping.mapping_rule import MappingRule
from gsfw.preparation.panorama_views import DIRECTIONS, view_side
from gsfw.preparation.preparation import Preparation
from gsfw.preparation.preparation_rule import PreparationRule
from gsfw.preparation.workspace import Workspace

TURNS = {one.name: one.from_panorama for one in DIRECTIONS}


def prepare(photos: Path, out: Path, rule: PreparationRule) -> dict[str, float]:
    """Prepare one data set; seconds of each stage."""
    place = Workspace(out)
    with place.claimed((photos,)):
        return Preparation((photos,), place, rule, lambda line: None).run().seconds


def errors(model: Path, walk: Walk) -> str:
    """Errors of all views."""
    found = pycolmap.Reconstruction(model)
    images = [found.image(number) for number in sorted(found.reg_image_ids())]
    keys = [(int(one.name[1:5]), one.name[6:].split(".")[0]) for one in images]
    centers = np.array([one.projection_center() for one in images])
    truth = np.array([walk.centers[number] for number, _ in keys])
    moved, wanted = centers - centers.mean(0), truth - truth.mean(0)
    left, sizes, right = np.linalg.svd(wanted.T @ moved)
    turn = left @ right
    moved = sizes.sum() / (moved**2).sum() * moved @ turn.T
    extent = np.linalg.norm(np.ptp(walk.centers, axis=0))
    away = 100 * np.linalg.norm(moved - wanted, axis=1) / extent
    angles = [
        pycolmap.Rotation3d(
            (TURNS[name] @ walk.turns[number]).T @ one.cam_from_world().rotation.matrix() @ turn.T
        ).angle()
        for one, (number, name) in zip(images, keys, strict=True)
    ]
    degrees = np.degrees(angles)
    return (
        f"{len(images)} views, {found.num_points3D()} points, "
        f"{found.compute_mean_reprojection_error():.2f} px; centres {away.mean():.4f} % (mean), "
        f"{away.max():.4f} % (largest); turns {degrees.mean():.4f} and {degrees.max():.4f} degrees"
    )


def main(folder: Path, count: int = 6, width: int = 1024) -> None:
    """Make the walk where it is not there, prepare it in all ways, and print the errors."""
    walk = Walk.of(count)
    if not (folder / "walk").is_dir():
        walk.write(folder / "walk", width)
    usual = PreparationRule(thorough=False)
    focal = view_side(width) / 2
    apart = CameraRule("one", "SIMPLE_PINHOLE", focal)
    ways = {
        "around": usual,
        "apart": replace(usual, cameras=apart, mapping=MappingRule(refine_focal=False)),
    }
    for name, rule in ways.items():
        photos = folder / "walk"
        if name == "apart":
            photos = folder / "views"
            shutil.copytree(folder / "around" / "images", photos, dirs_exist_ok=True)
        start = time.process_time()
        seconds = prepare(photos, folder / name, rule)
        used = time.process_time() - start
        found = errors(folder / name / "sparse" / "0", walk)
        sys.stdout.write(f"{name}: {found}; {used:.0f} s of this process, {seconds}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]), **{k: int(v) for k, v in (word.split("=") for word in sys.argv[2:])})
