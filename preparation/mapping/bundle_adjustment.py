"""Bundle adjustment by COLMAP, without the lines that its own function prints on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gsfw.preparation.cancellation import cancellable

if TYPE_CHECKING:
    from pycolmap import BundleAdjustmentOptions, Reconstruction


def adjustment_options(jobs: int) -> BundleAdjustmentOptions:
    """COLMAP's options, with a loss that bounds the effect of outliers.

    Args:
        jobs: threads; with one the bits are the same each time.
    """
    import pycolmap

    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_sensor_from_rig = False
    options.ceres.solver_options.num_threads = jobs
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    return options


def adjust(
    model: Reconstruction, options: BundleAdjustmentOptions, known_cameras: Sequence[int] = ()
) -> None:
    """Adjust all that a model has but known cameras, in place; an interruption comes after it.

    It gives the bits of ``pycolmap.bundle_adjustment``, which would reset COLMAP's log and print.
    """
    import pycolmap

    pycolmap.ObservationManager(model).filter_observations_with_negative_depth()
    config = pycolmap.BundleAdjustmentConfig()
    for number in model.reg_image_ids():
        config.add_image(number)
    for number in known_cameras:
        if model.exists_camera(number):
            config.set_constant_cam_intrinsics(number)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    adjuster = pycolmap.create_default_bundle_adjuster(options, config, model)
    cancellable(lambda token: adjuster.solve())
    model.update_point_3d_errors()
