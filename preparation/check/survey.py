"""Survey: all that is measured of a capture before anything is judged."""

from __future__ import annotations

from functools import cached_property

from gsfw.core.datamanager import DataManager
from gsfw.core.progress import stage
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


class Survey:
    """Measurements of cameras, points and a sample of the images, each made when it is asked for.

    Findings about cameras can so be told before any image is decoded. Whoever closes the data
    first calls ``measure``.
    """

    def __init__(self, data: DataManager, images: int | None = None) -> None:
        """Measure nothing yet.

        Args:
            data: is read, and not closed.
            images: number of images to decode; 0: all; ``None``: what takes a few seconds.
        """
        self._data, self._images = data, images
        self.scene: Scene = data.scene

    @staticmethod
    def of(data: DataManager, images: int | None = None) -> Survey:
        """Measure all of a data set, which may be closed afterwards; see ``__init__``."""
        survey = Survey(data, images)
        survey.measure()
        return survey

    def measure(self) -> None:
        """Make all measurements that were not made yet."""
        for name, found in vars(Survey).items():
            if isinstance(found, cached_property):
                getattr(self, name)

    @cached_property
    def viewpoints(self) -> Viewpoints:
        """Cameras of all views."""
        with stage("measuring cameras"):
            return Viewpoints.of(self._data)

    @cached_property
    def surface(self) -> Surface | None:
        """``None`` where there are no points and cameras look at no one point."""
        viewpoints = self.viewpoints  # Before the stage: one is shown at a time.
        with stage("measuring points"):
            return Surface.of(self.scene, viewpoints)

    @cached_property
    def angles(self) -> Angles | None:
        """``None`` where there is no surface."""
        surface, viewpoints = self.surface, self.viewpoints
        with stage("measuring angles between cameras"):
            return None if surface is None else Angles.of(surface, viewpoints)

    @cached_property
    def files(self) -> Files:
        """Counts over all image files."""
        return Files.of(self._data)

    @cached_property
    def sample(self) -> ImageSample:
        """Measurements of decoded images."""
        images = self._images
        if images is None:
            images = VIDEO_IMAGES if self.files.in_videos else IMAGES
        return ImageSample.of(self._data, self.viewpoints, images)

    @cached_property
    def agreement(self) -> Agreement | None:
        """``None`` where there are too few points in too few images."""
        surface, viewpoints, sample = self.surface, self.viewpoints, self.sample
        with stage("comparing images"):
            return Agreement.of(surface, viewpoints, sample)

    @cached_property
    def track_colors(self) -> TrackColors:
        """Colours of tracked points in the sampled images; none without tracks."""
        views = [image.view for image in self.sample.images]
        return TrackColors.of(self._data, self.viewpoints, views)

    @cached_property
    def view_dependence(self) -> ViewDependence | None:
        """``None`` where these are too few."""
        colors = self.track_colors
        with stage("measuring view dependence"):
            return ViewDependence.of(colors)

    @cached_property
    def cross_check(self) -> CrossCheck:
        """Agreement of the sampled images with their cameras, by matches between them."""
        viewpoints, sample = self.viewpoints, self.sample
        with stage("matching images"):
            return CrossCheck.of(self._data, viewpoints, sample)

    @cached_property
    def lenses(self) -> tuple[LensGroup, ...]:
        """Images that one lens took at one setting."""
        viewpoints = self.viewpoints
        with stage("comparing lenses"):
            return lens_groups(self._data, viewpoints)

    @cached_property
    def leftovers(self) -> Leftovers:
        """Files that are not used."""
        return Leftovers.of(self._data)

    @cached_property
    def time_order(self) -> TimeOrder | None:
        """``None`` where no camera stands still."""
        viewpoints = self.viewpoints
        with stage("comparing times"):
            return TimeOrder.of(self._data, viewpoints)
