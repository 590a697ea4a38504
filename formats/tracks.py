"""Tracks: the paths of a model's Gaussians as a NumPy archive.

``numpy.load("tracks.npz")`` gives, for t times and n Gaussians:

    positions   float32 [t, n, 3]  from ``origin``, in the world of the data; NaN when not there
    origin      float64 [3]        offset of the positions (map coordinates need float64)
    opacities   float32 [t, n]     in [0, 1]; 0 when not there
    present     bool    [t, n]     true where a Gaussian is present
    colors      uint8   [n, 3]     colour at its first presence
    times       float64 [t]        in [0, 1]
    data_times  float64 [t]        the same in the data's own unit

Gaussian i is row i at all times, as it is in the model.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from gsfw.core.color_bytes import color_bytes
from gsfw.core.exchange import Exporter, ExportSource, Holds
from gsfw.core.files.atomic import write_atomically


class TracksExporter(Exporter):
    """Writes ``.npz``."""

    suffix = ".npz"
    holds = Holds.TRACKS

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically.

        Raises:
            OutputError: it cannot be written.
        """
        content = source.track_file()
        tracks, origin = content.tracks, content.origin
        buffer = io.BytesIO()
        np.savez(
            buffer,
            positions=(tracks.positions - origin).float().numpy(),
            origin=origin.double().numpy(),
            opacities=tracks.opacities.float().numpy(),
            present=tracks.present.numpy(),
            colors=color_bytes(content.colors).numpy(),
            times=np.array(tracks.times),
            data_times=np.array(content.data_times),
        )
        write_atomically(path, buffer.getvalue())
