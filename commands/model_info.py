"""What `gsfw info` says of a model file; reads its header alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gsfw.core.datamanager import Split
from gsfw.formats.model_file import read_model_header

SHOWN = ("strategy", "steps", "seed", "sh_degree", "downscale", "profile")
"""The settings that tell models apart at a glance; the header has them all."""


def describe_model(path: Path) -> dict[str, Any]:
    """The document of a model file.

    Raises:
        DataError: the file is damaged, or of a newer gsfw.
    """
    model, header = read_model_header(path)
    scene, size = model.scene, path.stat().st_size
    return {
        "kind": "model file",
        "path": str(path),
        "version": header["version"],
        "method": model.method,
        "num_gaussians": model.rows,
        "steps_done": model.step,
        "bytes": size,
        "bytes_per_splat": round(size / max(model.rows, 1), 1),
        "columns": list(model.columns),
        "scene": {
            "name": scene.name,
            "extent": scene.extent,
            "num_times": scene.num_times,
            "time_range": None if scene.time_range is None else list(scene.time_range),
            "up": scene.up,
        },
        "cameras": {split.value: len(model.views[split]) for split in Split},
        "render": dict(header["render"]),
        "settings": {key: model.settings[key] for key in SHOWN if key in model.settings},
        "made_by": {
            "gsfw": header.get("gsfw"),
            "package": f"{model.distribution} {model.distribution_version}",
        },
    }
