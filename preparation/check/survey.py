"""Survey: all that is measured of a capture before anything is judged."""

from __future__ import annotations

from dataclasses import dataclass

from gsfw.core.datamanager import DataManager
from gsfw.core.scene import Scene
from gsfw.preparation.check.agreement import Agreement
from gsfw.preparation.check.cross_check import CrossCheck
from gsfw.preparation.check.image_sample import Files, ImageSample
from gsfw.preparation.check.leftovers import Leftovers
from gsfw.preparation.check.lens_groups import LensGroup, lens_groups
from gsfw.preparation.check.time_order import TimeOrder
from gsfw.preparation.check.track_colors import TrackColors
from gsfw.preparation.check.view_dependence import ViewDependence
from gsfw.preparation.check.viewpoints import Angles, Surface, Viewpoints

IMAGES, VIDEO_IMAGES = 50, 16
"""Default numbers of images to decode: a few seconds for files of 1 to 2 megapixels;
each image of a video takes a second or two, for all between it and the last key frame is decoded
as well."""


@dataclass(frozen=True)
class Survey:
    """Measurements of cameras, points and a sample of the images."""

    scene: Scene
    viewpoints: Viewpoints
    surface: Surface | None
    """``None`` where there are no points and cameras look at no one point."""
    angles: Angles | None
    """``None`` as well then."""
    files: Files
    sample: ImageSample
    agreement: Agreement | None
    """``None`` where there are too few points in too few images."""
    track_colors: TrackColors
    """Colours of tracked points in the sampled images; none without tracks."""
    view_dependence: ViewDependence | None
    """``None`` where these are too few."""
    cross_check: CrossCheck
    """What the sampled images say of their cameras."""
    lenses: tuple[LensGroup, ...]
    """Images that one lens took at one setting."""
    leftovers: Leftovers
    """Files that are not used."""
    time_order: TimeOrder | None
    """``None`` where no camera stands still."""

    @staticmethod
    def of(data: DataManager, images: int | None = None) -> Survey:
        """Measure a data set.

        Args:
            data: is read, and not closed.
            images: how many to decode; 0: all; ``None``: what takes a few seconds.
        """
        scene, viewpoints = data.scene, Viewpoints.of(data)
        files, surface = Files.of(data), Surface.of(scene, viewpoints)
        if images is None:
            images = VIDEO_IMAGES if files.in_videos else IMAGES
        sample = ImageSample.of(data, viewpoints, images)
        colors = TrackColors.of(data, viewpoints, [image.view for image in sample.images])
        return Survey(
            scene=scene,
            viewpoints=viewpoints,
            surface=surface,
            angles=None if surface is None else Angles.of(surface, viewpoints),
            files=files,
            sample=sample,
            agreement=Agreement.of(surface, viewpoints, sample),
            track_colors=colors,
            view_dependence=ViewDependence.of(colors),
            cross_check=CrossCheck.of(data, viewpoints, sample),
            lenses=lens_groups(data, viewpoints),
            leftovers=Leftovers.of(data),
            time_order=TimeOrder.of(data, viewpoints),
        )
