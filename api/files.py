"""Files: exporters, importers, and what they write and read."""

from gsfw.core.exchange import (
    Exporter,
    ExportSource,
    Holds,
    Importer,
    SplatFile,
    StoredModel,
    TrackFile,
)
from gsfw.core.files.atomic import write_atomically

__all__ = [
    "ExportSource",
    "Exporter",
    "Holds",
    "Importer",
    "SplatFile",
    "StoredModel",
    "TrackFile",
    "write_atomically",
]
