"""Descriptions of splat files and model files, as plain data for `gsfw info`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jaxtyping import Float
from torch import Tensor

from gsfw.core.datamanager import Split
from gsfw.core.exchange import SplatFile, StoredModel
from gsfw.core.splats import Sh
from gsfw.formats.array_archive import array_bytes
from gsfw.formats.model_file import ROWS, Precision, read_model_header
from gsfw.formats.model_header import CODED, STATE

SHOWN = ("strategy", "steps", "seed", "sh_degree", "downscale", "profile")
"""The settings that distinguish models; the header has them all."""


def describe_splats(path: Path, form: str, content: SplatFile, size: int) -> dict[str, Any]:
    """The document of a splat file.

    Args:
        path: the file, or the folder.
        form: its format, as the name of an importer.
        content: content of the file; at least one splat.
        size: bytes of the file, with those beside it that belong to it.
    """
    splats = content.splats
    low, high = splats.means.amin(dim=0), splats.means.amax(dim=0)
    scales = splats.scales
    assert scales is not None
    return {
        "kind": "splat file",
        "path": str(path),
        "format": form,
        "num_gaussians": len(splats),
        "num_dropped": content.num_dropped,
        "notes": list(content.notes()),
        "sh_degree": splats.colors.degree if isinstance(splats.colors, Sh) else None,
        "bytes": size,
        "bytes_per_splat": round(size / len(splats), 1),
        "antialiased": content.antialiased,
        "up": content.up,
        "extent": {"min": low.tolist(), "max": high.tolist(), "size": (high - low).tolist()},
        "opacity": _spread(splats.opacities),
        "scale": _spread(scales.flatten()),
        # Scales of 0 are allowed; JSON has no infinity.
        "longest_to_shortest_axis": _spread(
            scales.amax(dim=1) / scales.amin(dim=1).clamp_min(1e-30)
        ),
        "file": dict(content.properties),
    }


def _spread(values: Float[Tensor, " n"]) -> dict[str, float]:
    """Smallest, median and largest value."""
    return {
        "min": float(values.min()),
        "median": float(values.median()),
        "max": float(values.max()),
    }


def describe_model(path: Path) -> dict[str, Any]:
    """The document of a model file.

    Raises:
        DataError: the file is damaged, or of a newer gsfw.
    """
    model, header = read_model_header(path)
    scene, size = model.scene, path.stat().st_size
    coded = header.get(CODED, {"precision": Precision.FLOAT32.value})
    return {
        "kind": "model file",
        "path": str(path),
        "version": header["version"],
        "method": model.method,
        "num_gaussians": model.rows,
        "steps_done": model.step,
        "bytes": size,
        "bytes_per_splat": round(size / max(model.rows, 1), 1),
        "precision": coded["precision"],
        "bytes_per_splat_of": _parts(path, model, size),
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
            "package": f"{model.distribution} {model.distribution_version}".strip(),
        },
    }


def _parts(path: Path, model: StoredModel, size: int) -> dict[str, float]:
    """Bytes of a model file for each Gaussian: by column, of the rows together, and of the rest."""
    held, parts = array_bytes(path), {}
    if ROWS in held:
        parts["positions and order"] = held[ROWS]
    for name, column in model.columns.items():
        stored = [STATE + part for part in (column.values, column.offsets) if part]
        if any(part in held for part in stored):
            parts[name] = sum(held.get(part, 0) for part in stored)
    parts["rest of the file"] = size - sum(parts.values())
    return {name: round(count / max(model.rows, 1), 2) for name, count in parts.items()}
