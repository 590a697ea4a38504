"""Data: captures, cameras, views, and the batches of a step."""

from gsfw.core.batch import Batch, Resampling, ViewMap
from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.datamanager import DataManager, DataRequest, Split, Views, WrappedDataManager
from gsfw.core.maths.similarity import Similarity
from gsfw.core.scene import Scene
from gsfw.datamanagers.capture import Capture
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.frames import Frame, Recording
from gsfw.datamanagers.images import read_header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.map_file import MapFile

__all__ = [
    "Batch",
    "CameraModel",
    "Cameras",
    "Capture",
    "CaptureConfig",
    "DataManager",
    "DataRequest",
    "Frame",
    "Lens",
    "MapFile",
    "Recording",
    "Resampling",
    "Scene",
    "Similarity",
    "Split",
    "ViewMap",
    "Views",
    "WrappedDataManager",
    "read_header",
]
