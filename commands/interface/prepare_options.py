"""Options of `gsfw prepare`, and the rules of its stages that they state."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from gsfw.commands.interface.arguments import positionals
from gsfw.commands.interface.execution import CpuExecutionOptions
from gsfw.core.cores import cores
from gsfw.core.ranges import number

if TYPE_CHECKING:
    from gsfw.preparation.preparation_rule import PreparationRule


@dataclass(kw_only=True)
class PrepareOptions(CpuExecutionOptions):
    """Make a data set from photos, videos or another tool's data set, and check it.

    Cameras are computed with COLMAP, which is part of the installation. The same command continues
    where it was stopped. Keys after train=true are those of gsfw train. Exit codes: 0 good, or
    usable with limits; 1 will not train; 2 a mistake in the command.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw prepare photos out=scene",
        "gsfw prepare photos out=scene train=true minutes=3",
        "gsfw prepare walk.mp4 out=scene frames=200",
        "gsfw prepare left/ right/ out=scene camera_model=OPENCV_FISHEYE",
        "gsfw prepare metashape.xml out=scene lens=keep dense=true",
        "gsfw prepare photos out=scene executor=ray",
    )

    inputs: tuple[str, ...] = positionals("INPUT...")
    """Folders of images, videos; or one data set that already has cameras."""
    out: str = ""
    """Folder of the result: new, or that of an earlier gsfw prepare. Empty: prepared/INPUT."""
    frames: int = number(150, at_least=3)
    """Number of sharp, well-spaced frames to take from all videos together."""
    poses: Literal["auto", "compute", "keep"] = "auto"
    """Compute new cameras, keep those of the data set, or auto: keep them if there are any."""
    panoramas: Literal["auto", "true", "false"] = "auto"
    """Cut 360-degree images (equirectangular) into views: those that metadata or pixels tell of
    (auto), all that are twice as wide as high (true), or none (false)."""
    panorama_views: Literal["around", "sphere"] = "around"
    """Views of each: six around, or these and one up and one down."""
    panorama_masks: str = "auto"
    """Masks of 360-degree images, bright where pixels count: one image for all, a folder with one
    for each, none, or auto: those in masks/ beside the images."""
    cameras: Literal["auto", "one", "per-folder", "per-image"] = "auto"
    """Images that share a camera: auto goes by EXIF, size and folder."""
    camera_model: str = "auto"
    """COLMAP's camera model, such as SIMPLE_RADIAL, OPENCV or OPENCV_FISHEYE."""
    focal: float | None = None
    """Focal length in pixels of the images, as a first guess; none: from EXIF, or a usual one."""
    feature_size: int | None = None
    """Longest side of images for finding features, in pixels; none: by the machine."""
    features: int | None = None
    """Maximum number of features of an image; none: by the machine and the number of images."""
    thorough: bool | None = None
    """Also find the finest features, in three times the time; none: if photos stay unused."""
    matching: Literal["auto", "exhaustive", "sequential", "retrieval"] = "auto"
    """Pairs of images to match: all pairs, neighbours in time, or similar images."""
    exhaustive_up_to: int = number(200, at_least=0)
    """Number of photos up to which matching=auto compares all pairs."""
    overlap: int = number(10, at_least=1)
    """Neighbours in time that sequential compares with each frame."""
    vocabulary: str = ""
    """A COLMAP vocabulary tree for retrieval. Empty: made from the images themselves."""
    mapper: Literal["incremental", "global"] = "incremental"
    """Place cameras one after the other (COLMAP) or all at once (GLOMAP)."""
    refine_focal: bool = True
    """Compute focal lengths, or keep the first guess."""
    refine_principal_point: bool = False
    """Compute principal points, or keep the middle of the image."""
    lens: Literal["pinhole", "keep"] = "pinhole"
    """Undistort images to PINHOLE cameras, or keep files and lenses."""
    jpeg_quality: int = number(95, at_least=1, at_most=100)
    """Quality of JPEG files that are encoded again."""
    layout: Literal["auto", "colmap", "transforms"] = "auto"
    """colmap, transforms (keeps times of a video's frames, for scenes that move), or auto:
    transforms for a data set with times or depths, or for videos where the method to train
    afterwards is for scenes that move; else colmap."""
    dense: bool = False
    """Also write dense.ply: points of all surfaces, found as init=dense does, for other tools."""
    jobs: int = number(0, at_least=0)
    """Cores to use, or jobs at a time with executor=ray; 0: all. With 1, the same images give the
    same bits; with more, poses differ in their last digits."""
    again: bool = False
    """Repeat all stages, including those that are finished."""
    train: bool = False
    """Train afterwards, into OUT/run; settings after it are for gsfw train (minutes: of
    training)."""


def preparation_rule(options: PrepareOptions) -> PreparationRule:
    """The rules of all stages.

    Raises:
        ConfigError: a value is invalid.
    """
    from gsfw.preparation.camera_grouping import CameraRule
    from gsfw.preparation.mapping.mapping_rule import MappingRule
    from gsfw.preparation.pairs import MatchingRule
    from gsfw.preparation.panorama_cutting import PanoramaRule
    from gsfw.preparation.panorama_masks import PanoramaMasks
    from gsfw.preparation.preparation_rule import PreparationRule
    from gsfw.preparation.writing.image_output import OutputRule
    from gsfw.preparation.writing.written_files import COLMAP, TRANSFORMS

    rule = PreparationRule(
        frames=options.frames,
        panoramas=PanoramaRule(
            options.panoramas, options.panorama_views, PanoramaMasks(options.panorama_masks)
        ),
        cameras=CameraRule(options.cameras, options.camera_model, options.focal),
        feature_size=options.feature_size,
        feature_count=options.features,
        thorough=options.thorough,
        matching=MatchingRule(
            matching=options.matching,
            exhaustive_up_to=options.exhaustive_up_to,
            overlap=options.overlap,
            vocabulary=Path(options.vocabulary) if options.vocabulary else None,
        ),
        mapping=MappingRule(options.mapper, options.refine_focal, options.refine_principal_point),
        output=OutputRule(options.lens, options.jpeg_quality),
        layout=TRANSFORMS if options.layout == TRANSFORMS else COLMAP,
        jobs=min(options.jobs or cores(), cores()),
    )
    rule.check()
    return rule
