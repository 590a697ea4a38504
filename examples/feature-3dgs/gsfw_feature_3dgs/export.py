"""The ``features`` file: positions, colours, opacities and features of all Gaussians, for NumPy."""

from __future__ import annotations

import io

import numpy as np

from gsfw.api import Exporter, dc_to_rgb, write_atomically


class Npz(Exporter):
    """Arrays means [n, 3] (world of the data), colors [n, 3], opacities [n], features [n, d]."""

    suffix = ".npz"

    def write(self, path, source):
        splats = source.splat_file().splats
        if splats.extra is None:
            raise ValueError("the Gaussians have no features; train with method=feature-3dgs")
        for name, values in splats.tensors().items():
            finite = values.flatten(1).isfinite().all(1) if values.dim() > 1 else values.isfinite()
            if not bool(finite.all()):
                raise ValueError(f"{name} of row {int((~finite).nonzero()[0])} is not finite")
        buffer = io.BytesIO()
        np.savez_compressed(
            buffer,
            means=splats.means.numpy(),
            colors=dc_to_rgb(splats.colors.coefficients[:, 0]).numpy().astype("f4"),
            opacities=splats.opacities.numpy().astype("f4"),
            features=splats.extra.numpy().astype("f4"),
        )
        write_atomically(path, buffer.getvalue())
