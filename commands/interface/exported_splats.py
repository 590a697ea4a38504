"""Exported splats: what a file of them lost of the splats that were written, and notes on it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsfw.core.progress import stage

if TYPE_CHECKING:
    from gsfw.core.exchange import Exporter, SplatFile
    from gsfw.core.splats import Splats
    from gsfw.plugins.registry import Registry

TOO_COARSE = 0.1
"""Rounding of positions, relative to the median splat, above which a note warns."""


@dataclass(frozen=True)
class FileLoss:
    """Loss of a file of splats, in images from all around."""

    psnr: float
    """PSNR of all images in dB, at most ``PSNR_MAX``."""
    degrees: tuple[int, int]
    """Degree of the SH colours before and in the file."""
    notes: tuple[str, ...]
    """Warnings about what the file does not say."""

    def __str__(self) -> str:
        """The PSNR and the number of images, in words."""
        from gsfw.core.metrics import PSNR_MAX
        from gsfw.plugins.orbit_psnr import VIEWS

        more = " or more: no difference" * (self.psnr == PSNR_MAX)
        return f"in {VIEWS} images from all around: {self.psnr:.1f} dB{more}"

    @property
    def degree_line(self) -> str:
        """A sentence on view dependence that is lost; empty for none."""
        before, after = self.degrees
        lost = f"view dependence (SH): degree {before} before, {after} now"
        return lost if after < before else ""

    def document(self) -> dict[str, Any]:
        """The figures as plain data."""
        from gsfw.plugins.orbit_psnr import VIEWS

        return {"psnr": round(self.psnr, 2), "views": VIEWS, "sh_degree": self.degrees[1]}


UNKNOWN: dict[str, Any] = {"psnr": None, "views": 0}
"""The figures of a file that is not compared."""


def is_comparable(path: Path, exporter: Exporter, registry: Registry) -> bool:
    """True if a written file can be read back."""
    from gsfw.plugins.initial_splats import importer_of

    return exporter.is_readable and importer_of(path, registry) is not None


def file_loss(path: Path, form: str, before: SplatFile, registry: Registry) -> FileLoss:
    """Read a written file, and compare its images with those of the splats before.

    Args:
        path: the file.
        form: name of its format.
        before: the splats, with SH colours.
        registry: the installed parts.
    """
    from gsfw.core.splats import Sh
    from gsfw.plugins.initial_splats import find_importer
    from gsfw.plugins.orbit_psnr import orbit_psnr

    with stage(f"reading {path.name}"):
        after = find_importer(path, registry).read(path)
    assert isinstance(before.splats.colors, Sh) and isinstance(after.splats.colors, Sh)  # noqa: PT018
    degrees = before.splats.colors.degree, after.splats.colors.degree
    notes = [
        f"format {form} does not say that the splats were trained with antialiasing: "
        "viewers will show small ones too bright."
    ] * (before.antialiased and not after.antialiased)
    return FileLoss(orbit_psnr(before, after), degrees, tuple(notes))


def splat_notes(taken: SplatFile) -> list[str]:
    """Warnings about the file, as sentences."""
    left_out = [f"{taken.num_dropped} splats were left out: they are not finite."]
    return left_out * bool(taken.num_dropped) + rounding_note(taken.splats)


def rounding_note(splats: Splats) -> list[str]:
    """Warning about coordinates far from the origin, where float32 is coarse."""
    import numpy as np

    if not len(splats) or splats.scales is None:
        return []
    farthest = float(splats.means.abs().max())
    rounding = float(np.spacing(np.float32(farthest)))
    size = float(splats.scales.median())
    if rounding <= TOO_COARSE * size:
        return []
    return [
        f"coordinates reach {farthest:g}, where float32 numbers are {rounding:.2g} apart, and the "
        f"median splat is {size:.2g} in size: the file looks coarser than the model. Move the "
        "data set nearer to its origin."
    ]
