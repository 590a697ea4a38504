"""Simpler lenses: what takes the place of a lens model whose coefficients came out impossible.

Few matches near the borders leave the higher coefficients of a model to chance, and its image may
fold over. A model with fewer coefficients fits the same features and matches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from gsfw.core.errors import DataError
from gsfw.preparation.camera_grouping import CameraGroup
from gsfw.preparation.feature_database import camera_of
from gsfw.preparation.native import opened_database
from gsfw.preparation.writing.camera_plan import CameraPlan
from gsfw.preparation.writing.moved_model import lens_of_camera

SIMPLER = {"OPENCV": "SIMPLE_RADIAL", "SIMPLE_RADIAL": "SIMPLE_PINHOLE"}
"""The model that comes next, for those that are chosen automatically; a pinhole cannot fold."""
MOST_ATTEMPTS = 4
"""Most mappings, as cameras may fail one after the other; then the writing says what is wrong."""


def impossible_lenses(model: Path) -> dict[int, str]:
    """Cameras of a model whose images cannot be undistorted, by number, and why.

    Args:
        model: folder of a model in COLMAP's layout.
    """
    from pycolmap import Reconstruction

    estimated = Reconstruction(model)
    found = {}
    for number in sorted({image.camera_id for image in estimated.images.values()}):
        try:
            CameraPlan.of(lens_of_camera(estimated.cameras[number], number), keep=False)
        except DataError as error:
            found[number] = error.message
    return found


def with_simpler_lenses(
    groups: Sequence[CameraGroup], impossible: Mapping[int, str]
) -> tuple[CameraGroup, ...]:
    """The groups, those of impossible lenses with the next simpler model, where there is one."""
    return tuple(
        replace(group, model=SIMPLER.get(group.model, group.model))
        if group.number in impossible
        else group
        for group in groups
    )


def what_changes(before: Sequence[CameraGroup], after: Sequence[CameraGroup]) -> str:
    """Say in one line which cameras are computed anew with which model."""
    changed = [(old, new) for old, new in zip(before, after, strict=True) if old != new]
    old, new = changed[0]
    images = sum(len(group.images) for group, _ in changed)
    which = f"camera {old.number}" if len(changed) == 1 else f"{len(changed)} cameras"
    return (
        f"cameras: the distortion of {which} ({images} images) came out impossible with "
        f"{old.model}; computing again with {new.model}, from the same features and matches"
    )


def set_lenses(database: Path, groups: Sequence[CameraGroup]) -> None:
    """Give the cameras of a database the models and first guesses of their groups.

    Features and matches stay: they were verified without distortion.

    Raises:
        DataError: COLMAP cannot work with the database.
    """
    with opened_database(database, "set the cameras") as opened:
        for group in groups:
            if not opened.exists_camera(group.number):
                continue
            if opened.read_camera(group.number).model_name == group.model:
                continue
            opened.update_camera(camera_of(group))
