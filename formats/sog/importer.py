"""Reads SOG, versions 1 and 2: an archive, or a description beside its images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int64, UInt8

from gsfw.core.errors import COPY_AGAIN, DataError, UserError
from gsfw.core.exchange import Importer, SplatFile
from gsfw.core.files.reading import bytes_of
from gsfw.formats.sog import texels
from gsfw.formats.sog.container import Container, Folder, opened
from gsfw.formats.sog.description import (
    MAX_PALETTE,
    Description,
    ShPalette,
    read_description,
    read_document,
)
from gsfw.formats.sog.quantisation import (
    FIRST_TAG,
    unpack_means,
    unpack_opacities,
    unpack_quats,
)
from gsfw.formats.sog.sh_palette import COEFFICIENTS, MAX_DEGREE, ROW
from gsfw.formats.stored_rows import StoredRows, activated

ALWAYS = 1 << 25
"""Numbers of all splats that are reserved for files of any size: 128 MB, as for 2.4 million splats
without SH. Images of equal splats, or of a grid of them, compress to almost nothing."""
NUMBERS = 14
"""Numbers of a splat without SH above the constant one."""
LEAST_BYTES = 1
"""Bytes of images for each splat of larger scenes, at least. Real ones take 10 or more: the low
bytes of positions alone are as good as random."""


@dataclass(frozen=True)
class Amount:
    """Splats that are described, and the images that should hold them."""

    count: int
    numbers: int
    """Numbers of all splats."""
    size: int
    """Bytes of the images."""

    @staticmethod
    def of(container: Container, about: Description) -> Amount:
        """The amount of a SOG."""
        palette = about.palette
        degree = 0 if palette is None else MAX_DEGREE if palette.degree is None else palette.degree
        numbers = about.count * (NUMBERS + 3 * COEFFICIENTS[degree])
        return Amount(about.count, numbers, sum(container.size(name) for name in about.images))

    def __add__(self, other: Amount) -> Amount:
        return Amount(
            self.count + other.count, self.numbers + other.numbers, self.size + other.size
        )

    def check(self, path: Path) -> None:
        """Refuse more splats than the images can hold, before any allocation.

        Raises:
            DataError: there are more.
        """
        if self.numbers > ALWAYS and self.count * LEAST_BYTES > self.size:
            raise DataError(
                f"{path} is cut short: it describes {self.count} splats, and their images have "
                f"{self.size} bytes.",
                COPY_AGAIN,
            )


class SogImporter(Importer):
    """Reads ``.sog``, and folders of images with ``meta.json``, given by either."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """True for an archive or a JSON that describes the images of a SOG."""
        try:
            with opened(path) as container:
                return read_document(container) is not None
        except UserError:
            return False

    def read(self, path: Path) -> SplatFile:
        """Read the file.

        Raises:
            DataError: it is damaged, of another version, or holds other content than 3D Gaussians.
        """
        with opened(path) as container:
            about = read_description(container)
            Amount.of(container, about).check(container.path)
            rows = read_rows(container, about)
        splats, dropped = activated(path, rows)
        about_file = {"version": str(about.version), "generator": about.generator}
        return SplatFile(
            splats,
            antialiased=about.antialiased,
            properties={name: text for name, text in about_file.items() if text},
            num_dropped=dropped,
        )

    def size(self, path: Path) -> int:
        """Bytes of the archive, or of the description and all of its images.

        Raises:
            DataError: as of ``read``.
        """
        with opened(path) as container:
            if not isinstance(container, Folder):
                return bytes_of(path)
            about = read_description(container)
            centroids = [about.palette.centroids] if about.palette else []
            names = [container.description, *about.images, *centroids]
            return sum(map(container.size, names))


def read_rows(container: Container, about: Description) -> StoredRows:
    """The values of all splats.

    Raises:
        DataError: an image is missing or damaged.
    """
    count = about.count
    low, high = (_image(container, name, count) for name in about.means)
    parts = low[:, :3].astype(np.uint16) | (high[:, :3].astype(np.uint16) << 8)
    del low, high
    quats = _image(container, about.quats, count)
    untagged = int((quats[:, 3] < FIRST_TAG).sum())
    if untagged:
        raise DataError(
            f"{container.path}: {untagged} of {count} rotations in {about.quats} do not tell their "
            "largest component.",
            COPY_AGAIN,
        )
    scales = _image(container, about.scales, count)
    colors = _image(container, about.colors, count)
    if about.logit_table is None:
        logits = unpack_opacities(colors[:, 3])
    else:
        logits = about.logit_table[colors[:, 3]]
    return StoredRows(
        means=unpack_means(parts, about.low, about.high),
        logits=logits,
        log_scales=_looked_up(scales, about.scale_table),
        quats=unpack_quats(quats),
        dc=_looked_up(colors, about.color_table),
        rest=_rest(container, about.palette, count),
    )


def _image(container: Container, name: str, count: int) -> UInt8[np.ndarray, "n 4"]:
    """The texels of an image that belong to splats."""
    most = texels.most_texels(count)
    content = container.read(name, texels.most_bytes(most))
    return texels.decode(container.path, name, content, count, most).reshape(-1, 4)[:count]


def _looked_up(
    indices: UInt8[np.ndarray, "n 4"], table: Float32[np.ndarray, "256 channels"]
) -> Float32[np.ndarray, "n 3"]:
    """The values of three channels, in a table of their own or in one for all."""
    values: np.ndarray = table[indices[:, :3], np.arange(3) % table.shape[1]]
    return values


def _rest(
    container: Container, palette: ShPalette | None, count: int
) -> Float32[np.ndarray, "n k 3"]:
    """SH coefficients above the constant ones."""
    if palette is None:
        return np.zeros((count, 0, 3), dtype=np.float32)
    vectors = _vectors(container, palette)
    image = _image(container, palette.labels, count)
    labels: Int64[np.ndarray, " n"] = image[:, 0] + image[:, 1].astype(np.int64) * 256
    beyond = int((labels >= len(vectors)).sum())
    if beyond:
        raise DataError(
            f"{container.path}: {beyond} of {count} labels in {palette.labels} are beyond the "
            f"{len(vectors)} SH vectors.",
            COPY_AGAIN,
        )
    rest: np.ndarray = vectors[labels]
    return rest


def _vectors(container: Container, palette: ShPalette) -> Float32[np.ndarray, "p k 3"]:
    """The SH vectors of a palette."""
    path, name = container.path, palette.centroids
    most = MAX_PALETTE * COEFFICIENTS[-1]
    content = container.read(name, texels.most_bytes(most))
    image = texels.decode(path, name, content, 1, most)
    height, width = image.shape[:2]
    widths = {ROW * number: number for number in COEFFICIENTS[1:]}
    wanted = widths.get(width, 0)
    if not wanted or palette.degree not in (None, COEFFICIENTS.index(wanted)):
        raise DataError(
            f"{path}: its image {name} is {width} texels wide, which belongs to no SH degree, or "
            "not to the one that is described.",
            COPY_AGAIN,
        )
    if palette.count is not None and palette.count > height * ROW:
        raise DataError(
            f"{path}: {palette.count} SH vectors are described, and {name} has {height * ROW}.",
            COPY_AGAIN,
        )
    values = _looked_up(image.reshape(-1, 4), palette.table)
    return values.reshape(-1, wanted, 3)[: palette.count]
