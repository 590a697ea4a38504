"""What `gsfw info` says of a splat file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsfw.core.splats import Sh
from gsfw.plugins.loading import load
from gsfw.plugins.registry import Registry

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor


def describe_splats(path: Path, importer: str, registry: Registry) -> dict[str, Any]:
    """The document of a splat file.

    Raises:
        DataError: the file is damaged.
    """
    content = load("importer", registry.slot("importer")[importer])().read(path)
    splats, size = content.splats, path.stat().st_size
    low, high = splats.means.amin(dim=0), splats.means.amax(dim=0)
    scales = splats.scales
    assert scales is not None
    return {
        "kind": "splat file",
        "path": str(path),
        "format": importer,
        "num_gaussians": len(splats),
        "sh_degree": splats.colors.degree if isinstance(splats.colors, Sh) else None,
        "bytes": size,
        "bytes_per_splat": round(size / len(splats), 1),
        "antialiased": content.antialiased,
        "up": content.up,
        "extent": {"min": low.tolist(), "max": high.tolist(), "size": (high - low).tolist()},
        "opacity": _spread(splats.opacities),
        "scale": _spread(scales.flatten()),
        # Scales of 0 are allowed; JSON knows no infinity.
        "longest_to_shortest_axis": _spread(
            scales.amax(dim=1) / scales.amin(dim=1).clamp_min(1e-30)
        ),
        "file": dict(content.properties),
    }


def _spread(values: Float[Tensor, " n"]) -> dict[str, float]:
    """Least, middle and largest value."""
    return {
        "min": float(values.min()),
        "median": float(values.median()),
        "max": float(values.max()),
    }
