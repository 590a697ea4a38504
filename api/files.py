"""Files: exporters, importers, and what they write and read.

An ``Exporter`` asks its ``ExportSource`` for the content that its format ``Holds``; an ``Importer``
returns a ``SplatFile``. Both work in the world of the data.
"""

from gsfw.core.exchange import (
    Exporter,
    ExportSource,
    Holds,
    Importer,
    SplatFile,
    StoredColumn,
    StoredModel,
    TrackFile,
)
from gsfw.core.files.atomic import write_atomically
from gsfw.core.temporal_metrics.tracks import Tracks

__all__ = [
    "ExportSource",
    "Exporter",
    "Holds",
    "Importer",
    "SplatFile",
    "StoredColumn",
    "StoredModel",
    "TrackFile",
    "Tracks",
    "write_atomically",
]
