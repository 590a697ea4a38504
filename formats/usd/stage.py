"""A stage of USD with one field of Gaussians, written by usd-core, OpenUSD's own package."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from shutil import copyfileobj
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float32, Float64

from gsfw.core.cameras import Cameras
from gsfw.core.exchange import MotionFile
from gsfw.core.files.atomic import atomic_file
from gsfw.core.maths.spherical_harmonics import degree_of
from gsfw.formats.usd.cameras import add_cameras
from gsfw.formats.usd.field import FieldValues
from gsfw.formats.usd.package import PACKAGE, SUFFIX, system_errors

if TYPE_CHECKING:
    from pxr import Usd, UsdVol

FIELD = "Gaussians"
"""Name of the prim of the field."""


@dataclass(frozen=True)
class Field:
    """A field of ``n`` Gaussians, to be written."""

    coefficients: Float32[np.ndarray, "n k 3"]
    """SH coefficients."""
    samples: Iterable[tuple[float, FieldValues]]
    """The other values by ascending time codes, at least one."""
    origin: Float64[np.ndarray, " 3"]
    """Place of the field; its positions are relative to it."""
    half: bool
    """True for values of 16 bits, but for positions."""


@dataclass(frozen=True)
class Playback:
    """Time of a moving stage."""

    last: float
    """Time code at the end; the first one is 0."""
    fps: float
    """Time codes that are played in a second."""


def write_stage(
    path: Path,
    field: Field,
    up: str,
    playback: Playback | None,
    about: MotionFile,
    cameras: Sequence[Cameras] = (),
) -> None:
    """Write a stage atomically, in the format of the suffix.

    Args:
        path: ends in .usdc, .usda, .usd or .usdz.
        field: the splats.
        up: axis that points up, "Y" or "Z".
        playback: ``None`` for a field at rest.
        about: the splats as they were given, for what the stage states of them.
        cameras: in the axes of the stage.

    Raises:
        OutputError: it cannot be written.
    """
    from pxr import Sdf, UsdUtils

    with atomic_file(path) as file, TemporaryDirectory(dir=path.parent, prefix=".usd-") as folder:
        stage = _stage(path.stem, about, up, playback)
        _fill(_prim(stage, field.origin), field)
        add_cameras(stage, cameras)
        # In a package, the suffix of the stage is the one of its format in bytes.
        inner = Path(folder) / path.with_suffix(SUFFIX).name
        written = Path(folder) / path.name
        with system_errors():
            if path.suffix.lower() == PACKAGE:
                stage.GetRootLayer().Export(str(inner))
                UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(inner)), str(written))
            else:
                stage.GetRootLayer().Export(str(written))
        with written.open("rb") as source:
            copyfileobj(source, file)


def _stage(name: str, about: MotionFile, up: str, playback: Playback | None) -> Usd.Stage:
    """An empty stage, with what it states of the splats."""
    from pxr import Kind, Tf, Usd, UsdGeom

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, f"/{Tf.MakeValidIdentifier(name)}").GetPrim()
    stage.SetDefaultPrim(root)
    Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
    stated: dict[str, Any] = {
        "version": version("gsfw"),
        "up": about.content.up,
        "antialiased": about.content.antialiased,
    }
    if playback is not None:
        stage.SetStartTimeCode(0.0)
        stage.SetEndTimeCode(playback.last)
        stage.SetTimeCodesPerSecond(playback.fps)
        stage.SetFramesPerSecond(playback.fps)
        stated["first_time"], stated["last_time"] = about.time_range or (0.0, 1.0)
    # The schema has no place for these.
    stage.GetRootLayer().customLayerData = {"gsfw": stated}
    return stage


def _prim(
    stage: Usd.Stage, origin: Float64[np.ndarray, " 3"]
) -> UsdVol.ParticleField3DGaussianSplat:
    """The field in its place, with the hints for its renderers."""
    from pxr import Gf, UsdVol

    path = stage.GetDefaultPrim().GetPath().AppendChild(FIELD)
    field = UsdVol.ParticleField3DGaussianSplat.Define(stage, path)
    field.CreateProjectionModeHintAttr("perspective")
    field.CreateSortingModeHintAttr("zDepth")
    if origin.any():
        field.AddTranslateOp().Set(Gf.Vec3d(*origin.tolist()))
    return field


@dataclass(frozen=True)
class _Attribute:
    """An attribute of the field, for one of ``FieldValues``."""

    name: str
    stored: Usd.Attribute
    kind: Any
    """Type of its arrays."""
    is_half: bool

    def set(self, array: np.ndarray, code: float | None = None) -> None:
        """Set its value at a time code, or its default.

        Raises:
            ValueError: a value is beyond floats of 16 bits.
        """
        if self.is_half:
            with np.errstate(over="ignore"):
                array = array.astype(np.float16)
            if not np.isfinite(array).all():
                raise ValueError(f"{self.name} are beyond floats of 16 bits; leave out format.half")
        held = self.kind.FromNumpy(np.ascontiguousarray(array))
        if code is None:
            self.stored.Set(held)
        else:
            self.stored.Set(held, code)


def _attributes(prim: UsdVol.ParticleField3DGaussianSplat, half: bool) -> list[_Attribute]:
    """The attributes of all ``FieldValues``."""
    from pxr import Vt

    small: dict[str, tuple[Usd.Attribute, Any]]
    if half:
        small = {
            "orientations": (prim.CreateOrientationshAttr(), Vt.QuathArray),
            "scales": (prim.CreateScaleshAttr(), Vt.Vec3hArray),
            "opacities": (prim.CreateOpacitieshAttr(), Vt.HalfArray),
        }
    else:
        small = {
            "orientations": (prim.CreateOrientationsAttr(), Vt.QuatfArray),
            "scales": (prim.CreateScalesAttr(), Vt.Vec3fArray),
            "opacities": (prim.CreateOpacitiesAttr(), Vt.FloatArray),
        }
    return [
        _Attribute("positions", prim.CreatePositionsAttr(), Vt.Vec3fArray, is_half=False),
        _Attribute("extent", prim.CreateExtentAttr(), Vt.Vec3fArray, is_half=False),
        *(_Attribute(name, stored, kind, half) for name, (stored, kind) in small.items()),
    ]


def _fill(prim: UsdVol.ParticleField3DGaussianSplat, field: Field) -> None:
    """Set the attributes: the first values as defaults, and time samples of those that change.

    Raises:
        ValueError: a value is beyond floats of 16 bits.
    """
    _set_colors(prim, field)
    attributes = _attributes(prim, field.half)
    following = iter(field.samples)
    start, first = next(following)
    for attribute in attributes:
        attribute.set(getattr(first, attribute.name))
    codes, changed = [start], set[str]()
    for code, values in following:
        for attribute in attributes:
            given, before = (getattr(item, attribute.name) for item in (values, first))
            if attribute.name not in changed:
                if np.array_equal(given, before):
                    continue
                changed.add(attribute.name)
                # It has been as at first until the code before this one.
                for earlier in codes:
                    attribute.set(before, earlier)
            attribute.set(given, code)
        codes.append(code)


def _set_colors(prim: UsdVol.ParticleField3DGaussianSplat, field: Field) -> None:
    """Set the SH coefficients, those of a Gaussian one after the other, and their layout."""
    from pxr import Vt

    per_row = field.coefficients.shape[1]
    prim.CreateRadianceSphericalHarmonicsDegreeAttr(degree_of(per_row))
    if field.half:
        stored, kind = prim.CreateRadianceSphericalHarmonicsCoefficientshAttr(), Vt.Vec3hArray
    else:
        stored, kind = prim.CreateRadianceSphericalHarmonicsCoefficientsAttr(), Vt.Vec3fArray
    colors = _Attribute("colours", stored, kind, field.half)
    colors.set(field.coefficients.reshape(-1, 3))
    # As of a primvar, which some readers take it for.
    stored.SetMetadata("interpolation", "vertex")
    stored.SetMetadata("elementSize", per_row)
