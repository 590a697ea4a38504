"""Own focal lengths: images that fit only with another focal length than the one of their camera.

A zoom or a second lens among images that share a camera is computed as a movement of the camera.
One more bundle adjustment, in which each image has a focal length of its own, undoes that.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from gsfw.preparation.diagnosis.residuals import errors_of, residuals_of
from gsfw.preparation.mapping.bundle_adjustment import adjust, adjustment_options
from gsfw.preparation.mapping.observations import Observations

if TYPE_CHECKING:
    from pycolmap import Camera, Image, Reconstruction

UNLIKE = 1.15
"""Ratio of two focal lengths of one lens that are too different: autofocus moves it by some per
cent. Own focal lengths are within 1.04 of their camera's in fox and plush, within 1.08 in rendered
images with a rolling shutter of 1 and 2.5 degrees, and 1.5 times over a plane that leaves them
open."""
EXPLAINED = 0.7
"""Part of an image's error that its own focal length may leave: 0.14 to 0.56 in three rendered
captures with a zoom of 1.7 or 2.2, 0.97 and more over that plane."""
MOST_OBSERVATIONS = 40_000
"""Points are left out beyond this, or beyond twice ``LEAST`` for each image if that is more: 24,000
observations take two seconds of a core."""
LEAST = 50
"""Observations from which an image's focal length is judged: its 7 unknowns fit almost any few. Of
360 synthetic images of one focal length (noise 1 pixel, points seen by three images), none were
named with 50, 7 with 30, and 47 with 15."""
ITERATIONS = 15
"""25 and 50 find the same images and focal lengths."""
PER_IMAGE = (
    "Compute the cameras again with a focal length for each image: gsfw prepare IMAGES out=DIR "
    "cameras=per-image; or sort the images of each focal length into a folder of its own, and use "
    "cameras=per-folder."
)
"""Remedy for images of several focal lengths that share a camera."""


def own_focals(model: Reconstruction, known_cameras: Collection[int] = ()) -> dict[str, float]:
    """Focal lengths in pixels by image, of those that surely have another than their camera.

    Args:
        model: with any lenses.
        known_cameras: numbers of those that need no look.
    """
    import pycolmap

    used = [model.image(number).camera_id for number in model.reg_image_ids()]
    if len(set(used)) == len(used) or set(used) <= set(known_cameras):
        return {}
    sample = _sampled(model)
    # The adjustment would leave these out, and errors be of other observations than before.
    pycolmap.ObservationManager(sample).filter_observations_with_negative_depth()
    before = _errors(sample)
    options = adjustment_options(jobs=1)
    options.ceres.solver_options.max_num_iterations = ITERATIONS
    adjust(sample, options)
    after = _errors(sample)
    found = {}
    for number in sorted(sample.reg_image_ids()):
        image = sample.image(number)
        if image.num_points3D < LEAST or model.image(number).camera_id in known_cameras:
            continue
        focal = sample.camera(image.camera_id).mean_focal_length()
        ratio = focal / model.camera(model.image(number).camera_id).mean_focal_length()
        is_better = after[image.name] < EXPLAINED * before[image.name]
        if is_better and max(ratio, 1 / ratio) > UNLIKE:
            found[image.name] = float(focal)
    return found


def _errors(model: Reconstruction) -> dict[str, float]:
    seen = Observations.of(model)
    return errors_of(model, seen, residuals_of(model, seen)[1])


def _sampled(model: Reconstruction) -> Reconstruction:
    """A copy of undistorted images, with a camera for each and as many points as there is time for.

    A lens of two focal lengths for each image would also fit the stretch of a rolling shutter.

    Args:
        model: with any lenses.
    """
    import pycolmap

    copy = pycolmap.Reconstruction()
    numbers = sorted(model.reg_image_ids())
    most = max(MOST_OBSERVATIONS, 2 * LEAST * len(numbers))
    step = 1 + model.compute_num_observations() // most
    points = [model.point3D(number) for number in sorted(model.point3D_ids())[::step]]
    features: dict[int, list[int]] = {number: [] for number in numbers}
    for point in points:
        for element in point.track.elements:
            features[element.image_id].append(element.point2D_idx)
    # Features of no chosen point would take more time than the adjustment.
    kept: dict[tuple[int, int], int] = {}
    for number, chosen in features.items():
        image = model.image(number)
        lens = model.camera(image.camera_id)
        places = _undistorted(image, lens, chosen)
        # A distortion that folds the image over cannot be undone everywhere.
        is_known = np.isfinite(places).all(axis=1)
        kept |= {(number, chosen[row]): place for place, row in enumerate(np.flatnonzero(is_known))}
        copy.add_camera_with_trivial_rig(
            pycolmap.Camera.create_from_model_name(
                number, "SIMPLE_PINHOLE", lens.mean_focal_length(), lens.width, lens.height
            )
        )
        taken = pycolmap.Image(image.name, places[is_known], number, number)
        copy.add_image_with_trivial_frame(taken, image.cam_from_world())
    for point in points:
        ends = [(end.image_id, end.point2D_idx) for end in point.track.elements]
        track = [pycolmap.TrackElement(end[0], kept[end]) for end in ends if end in kept]
        if len(track) > 1:
            copy.add_point3D(point.xyz, pycolmap.Track(track))
    return copy


def _undistorted(image: Image, lens: Camera, features: list[int]) -> Float64[np.ndarray, "f 2"]:
    """Pixels where a lens of the same focal length without distortion shows some features."""
    found = image.points2D
    pixels = np.array([found[feature].xy for feature in features]).reshape(-1, 2)
    middle = np.array([lens.width, lens.height]) / 2
    return lens.mean_focal_length() * lens.cam_from_img(pixels) + middle
