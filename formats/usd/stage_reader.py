"""Reader of stages, in a process of its own: damage of a file may end OpenUSD's native code.

``python -m gsfw.formats.usd.stage_reader`` takes a list of JSON from its standard input, the paths
of the stage and of a file for NumPy. It writes the values of all fields of Gaussians to that file,
with a text of JSON that describes them. It imports no torch.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from pxr import Usd

ABOUT = "about"
"""Name of the description among the arrays."""
ALWAYS = 1_000_000
"""Splats that may come from repeated use of few; more only if the files have as many bytes."""
RADIANCE = "radiance:sphericalHarmonics"
NAMES = {
    "positions": "positions",
    "orientations": "orientations",
    "scales": "scales",
    "opacities": "opacities",
    "coefficients": f"{RADIANCE}Coefficients",
}
"""Attributes of a field by the names that they have here."""


def read_stage(path: Path, out: Path) -> None:
    """Write the fields of a stage at its first time.

    Arrays are ``INDEX.matrix`` (from the field to the stage, for columns) and ``INDEX.NAME`` of
    ``NAMES``, without those that a field lacks. A file of few splats that are used so often that
    memory would not hold them has none of them.
    """
    from pxr import Usd, UsdGeom

    stage, first = Usd.Stage.Open(str(path)), Usd.TimeCode.EarliestTime()
    fields, transforms = _fields(stage), UsdGeom.XformCache(first)
    total = sum(len(_value(prim, "positions")) for prim in fields)
    layers = {Path(layer.realPath) for layer in stage.GetUsedLayers() if layer.realPath}
    size = sum(item.stat().st_size for item in layers if item.is_file())
    is_justified = total <= max(ALWAYS, size)
    own = stage.GetRootLayer().customLayerData.get("gsfw")
    about = {
        "total": total,
        "is_justified": is_justified,
        "up_axis": str(UsdGeom.GetStageUpAxis(stage)),
        "unit": UsdGeom.GetStageMetersPerUnit(stage),
        "moves": any(item.GetNumTimeSamples() > 1 for prim in fields for item in _stored(prim)),
        "fields": [
            {"path": str(prim.GetPath()), "degree": prim.GetAttribute(f"{RADIANCE}Degree").Get()}
            for prim in fields
        ],
        "gsfw": {name: own[name] for name in ("up", "antialiased") if name in own} if own else {},
    }
    arrays: dict[str, Any] = {ABOUT: np.array(json.dumps(about))}
    for index, prim in enumerate(fields if is_justified else ()):
        arrays[f"{index}.matrix"] = np.array(transforms.GetLocalToWorldTransform(prim)).T
        for name, attribute in NAMES.items():
            arrays[f"{index}.{name}"] = _value(prim, attribute)
    with out.open("wb") as file:
        np.savez(file, **arrays)


def _fields(stage: Usd.Stage) -> list[Usd.Prim]:
    """The visible fields of Gaussians of the scene, also those of instances."""
    from pxr import Usd, UsdGeom, UsdVol

    first = Usd.TimeCode.EarliestTime()
    return [
        prim
        for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies())
        if prim.IsA(UsdVol.ParticleField3DGaussianSplat)
        and UsdGeom.Imageable(prim).ComputeVisibility(first) != UsdGeom.Tokens.invisible
    ]


def _stored(prim: Usd.Prim) -> list[Usd.Attribute]:
    """The attributes of the splats that a prim has."""
    found = [prim.GetAttribute(f"{name}{end}") for name in NAMES.values() for end in ("", "h")]
    return [attribute for attribute in found if attribute.HasAuthoredValue()]


def _value(prim: Usd.Prim, name: str) -> np.ndarray:
    """An array at the first time, in 32 bits or else in 16; empty if there is none.

    Rotations become xyzw in NumPy.
    """
    from pxr import Usd

    for attribute in (prim.GetAttribute(name), prim.GetAttribute(f"{name}h")):
        value = attribute.Get(Usd.TimeCode.EarliestTime()) if attribute.HasAuthoredValue() else None
        if value is not None:
            return np.array(value)
    return np.empty(0)


if __name__ == "__main__":
    read_stage(*map(Path, json.load(sys.stdin)))
