"""Files: exporters, importers, and what they write and read.

An ``Exporter`` asks its ``ExportSource`` for the content that its format ``Holds``; an ``Importer``
returns a ``SplatFile``. Both work in the world of the data.
"""

from gsfw.core.exchange import (
    DepthView,
    Exporter,
    ExportSource,
    Holds,
    Importer,
    Motion,
    MotionFile,
    Preview,
    SplatFile,
    StoredColumn,
    StoredModel,
    TrackFile,
)
from gsfw.core.files.atomic import atomic_file, write_atomically
from gsfw.core.temporal_metrics.tracks import Tracks

__all__ = [
    "DepthView",
    "ExportSource",
    "Exporter",
    "Holds",
    "Importer",
    "Motion",
    "MotionFile",
    "Preview",
    "SplatFile",
    "StoredColumn",
    "StoredModel",
    "TrackFile",
    "Tracks",
    "atomic_file",
    "write_atomically",
]
