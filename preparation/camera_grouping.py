"""Camera grouping: which images share a camera, its model, and a first guess of its focal length.

See https://colmap.github.io/cameras.html for the models.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from gsfw.core.config import AUTO
from gsfw.core.errors import ConfigError
from gsfw.core.words import listed
from gsfw.datamanagers.lens import COEFFICIENTS
from gsfw.preparation.image_set import ImageSet, SourceImage

FEW = 20
"""Groups of fewer images get the simpler model. COLMAP's documentation advises OPENCV where
images share a camera and SIMPLE_RADIAL where each has its own; the number is our judgement, as
few images have few points in their corners, which the further coefficients are about.
Measured on the fox photos, distorted by a known lens, the mean error of the lens in pixels was
2.0 (SIMPLE_RADIAL) and 2.4 (OPENCV) with 10 photos, 0.5 and 0.1 to 0.8 in two runs with 24, and
0.5 and 0.4 with all 50: no large difference either way."""

MODEL_OF_VIEWS = "SIMPLE_PINHOLE"
"""The model of views that were cut from panoramas: their cameras are known exactly."""
PANORAMA = "panorama"
"""Origin of their focal lengths."""
MODEL_OF_FEW, MODEL_OF_MANY = "SIMPLE_RADIAL", "OPENCV"

USUAL_FOCAL = 1.2
"""Longer edges of the image; COLMAP's default (``default_focal_length_factor``)."""


@dataclass(frozen=True)
class CameraRule:
    """The user's choices about cameras."""

    cameras: Literal["auto", "one", "per-folder", "per-image"] = "auto"
    """The images that share one; auto: by EXIF and size."""
    model: str = AUTO
    """One of COLMAP's camera models, or auto: never one for fisheye lenses."""
    focal: float | None = None
    """Focal length of all cameras in pixels; ``None`` to look at EXIF."""

    def check(self) -> None:
        """Check each setting.

        Raises:
            ConfigError: one is not allowed.
        """
        if self.model != AUTO and self.model.upper() not in COEFFICIENTS:
            raise ConfigError(
                f"camera_model={self.model}: there is no such camera model.",
                f"Expected auto, or one of {', '.join(COEFFICIENTS)}.",
            )
        if self.focal is not None and not (math.isfinite(self.focal) and self.focal > 0):
            raise ConfigError(f"focal={self.focal:g}: expected a positive number of pixels.")


def group_cameras(images: ImageSet, rule: CameraRule) -> tuple[CameraGroup, ...]:
    """The cameras, numbered from 1 in the order in which they come in the set.

    Raises:
        ConfigError: the rule is not allowed, or makes images of several sizes share a camera.
    """
    rule.check()
    members: dict[Hashable, list[SourceImage]] = {}
    for image in images.images:
        members.setdefault(_camera(image, rule.cameras), []).append(image)
    for shared in members.values():
        if shared[0].view is None:
            _check_one_size(shared, rule)
    groups = [_group(number, found, rule) for number, found in enumerate(members.values(), 1)]
    rigs: dict[int, int] = {}
    return tuple(
        group
        if group.view is None
        else replace(group, rig=rigs.setdefault(group.width, group.number))
        for group in groups
    )


def _camera(image: SourceImage, cameras: str) -> Hashable:
    """Equal for images that share a camera.

    Views of panoramas share one with those of the same direction: a rig has several cameras.
    """
    if image.view is not None:
        return PANORAMA, image.header.width, image.view.number
    if cameras == "one":
        return ""
    if cameras == "per-folder":
        return image.group
    if cameras == "per-image":
        return image.name
    # Upright and sideways photos of one phone come from one sensor, but a model describes upright
    # images: its width, height and principal point are others once the image is turned.
    size = image.header.width, image.header.height
    # A rig of several cameras without EXIF has a folder for each.
    return size, image.exif.camera if image.exif.names_camera else image.group


def _check_one_size(shared: Sequence[SourceImage], rule: CameraRule) -> None:
    names: dict[str, list[str]] = {}
    for image in shared:
        size = f"{image.header.width}x{image.header.height}"
        names.setdefault(size, []).append(image.name)
    if len(names) == 1:
        return
    sizes = ", ".join(f"{size} ({listed(found, 1)})" for size, found in names.items())
    which = f" in {shared[0].group}" if rule.cameras == "per-folder" and shared[0].group else ""
    raise ConfigError(
        f"cameras={rule.cameras}: the images{which} have several sizes: {sizes}.",
        "One camera has one size, and upright and sideways photos count as two. Use cameras=auto, "
        "or bring the images to one size.",
    )


def _group(number: int, images: Sequence[SourceImage], rule: CameraRule) -> CameraGroup:
    header, view = images[0].header, images[0].view
    model = rule.model.upper()
    if view is not None:
        model = MODEL_OF_VIEWS
    elif rule.model == AUTO:
        model = MODEL_OF_FEW if len(images) < FEW else MODEL_OF_MANY
    focal, origin = _first_focal(images, rule) if view is None else (view.focal, PANORAMA)
    return CameraGroup(
        number=number,
        model=model,
        width=header.width,
        height=header.height,
        focal=focal,
        focal_origin=origin,
        images=tuple(image.name for image in images),
        view=None if view is None else view.number,
    )


def _first_focal(images: Sequence[SourceImage], rule: CameraRule) -> tuple[float, str]:
    """Initial focal length in pixels, and its source."""
    if rule.focal is not None:
        return rule.focal, "given"
    width, height = images[0].header.width, images[0].header.height
    told = [image.exif.focal_pixels(width, height) for image in images]
    known = [focal for focal in told if focal is not None]
    if known:
        return statistics.median(known), "EXIF"
    return USUAL_FOCAL * max(width, height), ""


@dataclass(frozen=True)
class CameraGroup:
    """One camera before calibration."""

    number: int
    """Counted from 1; COLMAP's camera id."""
    model: str
    """One of COLMAP's camera models, such as SIMPLE_RADIAL."""
    width: int
    """Pixels of the upright images."""
    height: int
    focal: float
    """First guess, in pixels."""
    focal_origin: str
    """Source of the focal length: "EXIF", "given", "panorama" (it is exact), or "" for a usual
    one."""
    images: tuple[str, ...]
    """Names, in the order of the set."""
    view: int | None = None
    """Position in ``panorama_views.DIRECTIONS``, of a camera of views of panoramas."""
    rig: int | None = None
    """Number of the first camera of the same panoramas; ``None`` for a camera of its own."""
