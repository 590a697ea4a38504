"""GltfImporter: reads the splats of .glb and .gltf files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float32, Float64

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.exchange import Importer, SplatFile
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.reading import bytes_of, first_bytes
from gsfw.core.maths.axes import stated_axis
from gsfw.core.maths.spherical_harmonics import num_coefficients
from gsfw.core.splats import Splats
from gsfw.formats.activation import dc_of, log_scales_of, logits_of
from gsfw.formats.gltf.document import Document, read_document
from gsfw.formats.gltf.layout import (
    COLOR_SPACE,
    DRAFT_ROTATION,
    DRAFT_SCALE,
    EXTENSION,
    MAGIC,
    MOST_DEGREE,
    OPACITY,
    ROTATION,
    SCALE,
    coefficient,
)
from gsfw.formats.gltf.nodes import placed_meshes
from gsfw.formats.placement import Matrix, placed
from gsfw.formats.stored_rows import MIN_LOG_SCALE, RDF_TO_LUF, StoredRows

LOGARITHMS = 0.25
"""Share of negative scales above which all scales are logarithms."""
ALWAYS = 1_000_000
"""Splats that may come from repeated use of few; more only if the file has as many bytes."""


class GltfImporter(Importer):
    """Reads all splats of the scene, in the places of their nodes."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """True for every .glb, so that one without splats is refused with its own reason."""
        start = first_bytes(path, 64)
        return start.startswith(MAGIC) or (
            path.suffix.lower() == ".gltf" and start.lstrip()[:1] == b"{"
        )

    def read(self, path: Path) -> SplatFile:
        """Read the file.

        Raises:
            DataError: it is damaged, no glTF, or holds other content than splats.
        """
        document = read_document(path)
        used = _placed_primitives(document)
        _check_size(document, used)
        read = [_splats(document, primitive, matrix) for primitive, matrix in used]
        asset = document.root.fields("asset", default={}).values
        stated = asset.get("extras")
        ours = stated.get("gsfw") if isinstance(stated, dict) else None
        ours = ours if isinstance(ours, dict) else {}
        generator = asset.get("generator")
        return SplatFile(
            Splats.cat([splats for splats, _ in read]),
            antialiased=ours.get("antialiased") is True,
            # The format's y axis points up; files of gsfw say what they know.
            up=stated_axis(ours.get("up", "-y")),
            properties={
                "sets of splats": str(len(used)),
                **({"generator": generator} if isinstance(generator, str) else {}),
            },
            num_dropped=sum(dropped for _, dropped in read),
        )

    def size(self, path: Path) -> int:
        """Bytes of the file, with the files beside it that its buffers link to.

        Raises:
            DataError: it is damaged or no glTF.
        """
        return bytes_of(path) + read_document(path, binary=False).buffers.beside()


def _placed_primitives(document: Document) -> list[tuple[JsonFields, Matrix]]:
    """The primitives of the scene that are splats."""
    root = document.root
    meshes = root.objects("meshes", default=[])
    by_mesh = [mesh.objects("primitives", default=[]) for mesh in meshes]
    found = [
        (primitive, matrix)
        for mesh, matrix in placed_meshes(root)
        for primitive in by_mesh[mesh]
        if EXTENSION in primitive.fields("extensions", default={})
    ]
    if not found:
        raise DataError(
            f"{root.path} contains no splats: none of its {sum(map(len, by_mesh))} meshes in the "
            f"scene has the extension {EXTENSION}.",
            "Export it as splats from the tool that made it.",
        )
    return found


def _check_size(document: Document, used: list[tuple[JsonFields, Matrix]]) -> None:
    """Refuse a file of few splats that are used so often that memory would not hold them."""
    accessors = document.root.objects("accessors", default=[])
    total = sum(
        primitive.fields("attributes").pick("POSITION", accessors).count("count")
        for primitive, _ in used
    )
    if total > ALWAYS and total > document.buffers.size():
        raise DataError(
            f"{document.root.path} announces {total} splats, which its size does not justify.",
            COPY_AGAIN,
        )


def _splats(document: Document, primitive: JsonFields, matrix: Matrix) -> tuple[Splats, int]:
    """The splats of a primitive in our frame, and the number of those that are not finite."""
    path = document.root.path
    splatting = primitive.fields("extensions").fields(EXTENSION)
    space = splatting.text("colorSpace", default=COLOR_SPACE)
    if space != COLOR_SPACE:
        raise DataError(
            f"{path}: {primitive.where} has colours of {space[:40]!r}, and those of a screen "
            f"({COLOR_SPACE}) are read.",
            "Export it in that colour space from the tool that made it.",
        )
    with np.errstate(over="ignore", invalid="ignore"):
        rows = _stored_rows(document, primitive).mirrored(RDF_TO_LUF)
        flip = np.diag([*RDF_TO_LUF, 1.0])
        matrix = flip @ matrix @ flip
    return placed(path, rows, matrix, primitive.where)


def _stored_rows(document: Document, primitive: JsonFields) -> StoredRows:
    """The values of a primitive, in the frame of the file."""
    attributes = primitive.fields("attributes")
    is_draft = coefficient(0) not in attributes and DRAFT_ROTATION in attributes
    degree = 0 if is_draft else _degree(attributes)
    scale, rotation = (DRAFT_SCALE, DRAFT_ROTATION) if is_draft else (SCALE, ROTATION)

    def values(name: str, kind: str) -> np.ndarray:
        where = f"{attributes.where}.{name}"
        array = document.values(attributes.count(name), kind, where)
        if len(array) != count:
            raise DataError(
                f"{document.root.path}: {where} has {len(array)} values, and there are {count} "
                "positions.",
                COPY_AGAIN,
            )
        return array

    where = f"{attributes.where}.POSITION"
    means = document.values(attributes.count("POSITION"), "VEC3", where)
    count = len(means)
    rest = np.empty((count, num_coefficients(degree) - 1, 3), dtype=np.float32)
    for index in range(rest.shape[1]):
        rest[:, index] = values(coefficient(index + 1), "VEC3")
    if is_draft:
        shown = values("COLOR_0", "VEC4")
        opacities, dc = shown[:, 3], dc_of(shown[:, :3])
    else:
        opacities, dc = values(OPACITY, "SCALAR")[:, 0], values(coefficient(0), "VEC3")
    return StoredRows(
        means=means,
        logits=logits_of(opacities),
        log_scales=_log_scales(values(scale, "VEC3")),
        quats=np.roll(values(rotation, "VEC4"), 1, axis=1).astype(np.float32),
        dc=dc.astype(np.float32),
        rest=rest,
    )


def _log_scales(scales: Float64[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
    """Logarithms of scales, which files of the review draft (until spring 2026) hold themselves.

    Linear scales are not negative.
    """
    if (scales < 0).mean() > LOGARITHMS:
        return np.maximum(scales, MIN_LOG_SCALE).astype(np.float32)
    return log_scales_of(scales)


def _degree(attributes: JsonFields) -> int:
    """The SH degree of a primitive: each band is whole, or missing with those above it."""
    present = sum(
        coefficient(index) in attributes for index in range(num_coefficients(MOST_DEGREE))
    )
    for degree in range(MOST_DEGREE + 1):
        if present == num_coefficients(degree):
            return degree
    raise DataError(
        f"{attributes.path}: {attributes.where} has {present} SH coefficients, expected 1, 4, 9 or "
        "16.",
        COPY_AGAIN,
    )
