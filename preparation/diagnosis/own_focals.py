"""Own focal lengths: images that fit only with another focal length than the one of their camera.

A zoom or a second lens among images that share a camera is computed as a movement of the camera.
One more bundle adjustment, in which each image has a focal length of its own, undoes that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gsfw.preparation.diagnosis.residuals import errors_of, residuals_of
from gsfw.preparation.mapping.bundle_adjustment import adjust, adjustment_options
from gsfw.preparation.mapping.observations import Observations

if TYPE_CHECKING:
    from pycolmap import Reconstruction

UNLIKE = 1.15
"""Ratio of two focal lengths of one lens that are too different: autofocus moves it by some per
cent. Own focal lengths are within 1.04 of their camera's in fox and plush, within 1.08 in rendered
images with a rolling shutter of 1 and 2.5 degrees, and 1.5 times over a plane that leaves them
open."""
EXPLAINED = 0.7
"""Part of an image's error that its own focal length may leave: 0.14 to 0.56 in three rendered
captures with a zoom of 1.7 or 2.2, 0.97 and more over that plane."""
MOST_OBSERVATIONS = 40_000
"""Points are left out beyond this: 24,000 observations take two seconds of a core."""
ITERATIONS = 15
"""25 and 50 find the same images and focal lengths."""
PER_IMAGE = (
    "Compute the cameras again with a focal length for each image: gsfw prepare IMAGES out=DIR "
    "cameras=per-image; or sort the images of each focal length into a folder of its own, and use "
    "cameras=per-folder."
)
"""Remedy for images of several focal lengths that share a camera."""


def own_focals(model: Reconstruction) -> dict[str, float]:
    """Focal lengths in pixels by image, of those that surely have another than their camera."""
    used = [model.image(number).camera_id for number in model.reg_image_ids()]
    if len(set(used)) == len(used):
        return {}
    shared, single = _sampled(model, own=False), _sampled(model, own=True)
    before = _errors(shared)
    options = adjustment_options(jobs=1)
    options.ceres.solver_options.max_num_iterations = ITERATIONS
    adjust(single, options)
    after = _errors(single)
    found = {}
    for number in sorted(single.reg_image_ids()):
        image = single.image(number)
        focal = single.camera(image.camera_id).mean_focal_length()
        ratio = focal / shared.camera(shared.image(number).camera_id).mean_focal_length()
        is_better = after.get(image.name, np.inf) < EXPLAINED * before.get(image.name, 0.0)
        if is_better and max(ratio, 1 / ratio) > UNLIKE:
            found[image.name] = float(focal)
    return found


def _errors(model: Reconstruction) -> dict[str, float]:
    seen = Observations.of(model)
    return errors_of(model, seen, residuals_of(model, seen)[1])


def _sampled(model: Reconstruction, own: bool) -> Reconstruction:
    """A copy of undistorted images, with as many points as there is time for.

    A lens of two focal lengths for each image would also fit the stretch of a rolling shutter.

    Args:
        model: with any lenses.
        own: whether each image has a camera of its own.
    """
    import pycolmap

    copy = pycolmap.Reconstruction()
    is_seen = {}
    for number in sorted(model.reg_image_ids()):
        image = model.image(number)
        lens = model.camera(image.camera_id)
        focal, sides = lens.mean_focal_length(), (lens.width, lens.height)
        camera_id = number if own else image.camera_id
        if not copy.exists_camera(camera_id):
            camera = pycolmap.Camera.create_from_model_name(
                camera_id, "SIMPLE_PINHOLE", focal, *sides
            )
            copy.add_camera_with_trivial_rig(camera)
        pixels = np.array([point.xy for point in image.points2D]).reshape(-1, 2)
        places = focal * lens.cam_from_img(pixels) + np.array(sides) / 2
        # A distortion that folds the image over cannot be undone everywhere.
        is_seen[number] = np.isfinite(places).all(axis=1)
        taken = pycolmap.Image(image.name, places, camera_id, number)
        copy.add_image_with_trivial_frame(taken, image.cam_from_world())
    step = 1 + model.compute_num_observations() // MOST_OBSERVATIONS
    for number in sorted(model.point3D_ids())[::step]:
        point = model.point3D(number)
        elements = [e for e in point.track.elements if is_seen[e.image_id][e.point2D_idx]]
        if len(elements) > 1:
            copy.add_point3D(point.xyz, pycolmap.Track(elements))
    return copy
