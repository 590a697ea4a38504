"""PreparationRule: all choices of the user on the way from images to a data set."""

from __future__ import annotations

from dataclasses import dataclass, field

from gsfw.preparation.camera_grouping import CameraRule
from gsfw.preparation.features import check_wanted
from gsfw.preparation.machines import Machines
from gsfw.preparation.mapping.mapping_rule import MappingRule
from gsfw.preparation.pairs import MatchingRule
from gsfw.preparation.panorama_cutting import PanoramaRule
from gsfw.preparation.writing.image_output import OutputRule
from gsfw.preparation.writing.written_files import COLMAP


@dataclass(frozen=True)
class PreparationRule:
    """The user's choices."""

    frames: int = 150
    """Number of frames to take from all videos together."""
    panoramas: PanoramaRule = field(default_factory=PanoramaRule)
    cameras: CameraRule = field(default_factory=CameraRule)
    feature_size: int | None = None
    """Longest side of images for features, in pixels; ``None`` to choose for the machine."""
    feature_count: int | None = None
    """Most features of an image; ``None`` to choose for the machine."""
    thorough: bool | None = None
    """True to look for the finest features of all images, ``None`` to do so if images would be
    left without a camera otherwise."""
    matching: MatchingRule = field(default_factory=MatchingRule)
    mapping: MappingRule = field(default_factory=MappingRule)
    output: OutputRule = field(default_factory=OutputRule)
    layout: str = COLMAP
    """Either ``COLMAP``, or ``TRANSFORMS``, which keeps the times of frames of videos."""
    jobs: int = 1
    """Number of cores. With one the same images give the same bits; with more, poses
    differ in their last digits."""
    machines: Machines | None = None
    """Machines of a cluster that find and match features; ``None`` if this one does."""

    def check(self) -> None:
        """Check the values whose types and ranges do not say all.

        Raises:
            ConfigError: one of them makes no sense.
        """
        check_wanted(self.feature_size, self.feature_count)
        self.cameras.check()
        self.matching.check()
