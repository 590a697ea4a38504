"""Figures of a model without fault."""

from dataclasses import replace

from gsfw.preparation.diagnosis.model_figures import (
    BaselineFigures,
    CameraFigures,
    ModelFigures,
    TrackFigures,
)
from gsfw.preparation.diagnosis.residuals import Stretch


def figures(**changes: object) -> ModelFigures:
    """Of 50 images of one camera.

    Args:
        changes: fields that are otherwise.
    """
    camera = CameraFigures(
        number=1,
        model="SIMPLE_RADIAL",
        width=1000,
        height=800,
        images=50,
        focal=900.0,
        first_focal=950.0,
        focal_origin="EXIF",
        view_degrees=58.0,
        principal_point=(500.0, 400.0),
        distortion={"k": 0.05},
    )
    usual = ModelFigures(
        registered=50,
        points=10_000,
        observations=60_000,
        error=0.7,
        errors={f"{number}.jpg": 0.7 for number in range(50)},
        seen={f"{number}.jpg": 1200 for number in range(50)},
        tracks=TrackFigures(6.0, 0.2, 15.0, 5.0, 0.0, 0.1),
        baselines=BaselineFigures(2.0, 0.1, 6.0, 60.0, 3.0),
        cameras=(camera,),
        stretch=Stretch(0.1, 1.0, 0.5, 1000),
        own_focals={},
    )
    return replace(usual, **changes)
