"""Data: captures and their views, and the batches of a step.

For authors of data formats. A format of images on disk derives from ``CaptureConfig`` and returns a
``Recording`` of ``Frame``s: undistortion, masks, per-view maps, shrinking, caching and the held-out
views are done for it. Any other source derives from ``DataManager``. ``WrappedDataManager`` changes
a part of another one. Poses are world-to-camera with OpenCV axes; ``pose_from_...`` functions make
them of other conventions.
"""

from gsfw.core.batch import Batch, MaskMode, Resampling, ViewMap
from gsfw.core.datamanager import DataManager, DataRequest, Split, Views, WrappedDataManager
from gsfw.datamanagers.capture import Capture
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.frames import Frame, Recording, no_points
from gsfw.datamanagers.images import Header, read_header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.map_file import MapFile
from gsfw.datamanagers.point_file import read_points
from gsfw.datamanagers.poses import (
    pose_from_center,
    pose_from_opencv,
    pose_from_opengl,
    pose_from_quaternion,
)
from gsfw.datamanagers.video import Shot, Video

__all__ = [
    "Batch",
    "Capture",
    "CaptureConfig",
    "DataManager",
    "DataRequest",
    "Frame",
    "Header",
    "Lens",
    "MapFile",
    "MaskMode",
    "Recording",
    "Resampling",
    "Shot",
    "Split",
    "Video",
    "ViewMap",
    "Views",
    "WrappedDataManager",
    "no_points",
    "pose_from_center",
    "pose_from_opencv",
    "pose_from_opengl",
    "pose_from_quaternion",
    "read_header",
    "read_points",
]
