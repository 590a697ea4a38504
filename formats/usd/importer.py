"""UsdImporter: reads the fields of Gaussians of a stage, at its first time."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from jaxtyping import Float64

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.exchange import Importer, SplatFile
from gsfw.core.files.reading import first_bytes, readable
from gsfw.core.maths.axes import stated_axis, turned_to_y
from gsfw.core.maths.spherical_harmonics import MAX_DEGREE, num_coefficients
from gsfw.core.splats import Splats
from gsfw.formats.activation import log_scales_of, logits_of
from gsfw.formats.placement import Matrix, placed
from gsfw.formats.stored_rows import StoredRows
from gsfw.formats.usd import stage_reader
from gsfw.formats.usd.package import PACKAGE, ZIP, check_available, unpacked
from gsfw.formats.usd.stage_reader import ABOUT

BINARY, TEXT = b"PXR-USDC", b"#usda"
LEAST_SECONDS, BYTES_A_SECOND = 60.0, 1 << 20
"""Longest time of the reading process: OpenUSD does not end on some damaged files."""

Arrays = Mapping[str, np.ndarray]


class UsdImporter(Importer):
    """Reads all fields of the scene, in the places of their prims."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """True for every stage, so that one without splats is refused with its own reason."""
        start = first_bytes(path, len(BINARY))
        is_package = start.startswith(ZIP) and path.suffix.lower() == PACKAGE
        return start.startswith((BINARY, TEXT)) or is_package

    def read(self, path: Path) -> SplatFile:
        """Read the file: the splats at its first time.

        Raises:
            DataError: it is damaged, no USD, or holds other content than splats.
            UnavailableError: usd-core is not installed.
        """
        check_available()
        with _read_stage(path) as arrays:
            about = json.loads(str(arrays[ABOUT]))
            _check(path, about)
            up, to_data = _world(about)
            read = []
            for index, field in enumerate(about["fields"]):
                rows = _stored_rows(path, index, field, arrays)
                matrix = to_data @ arrays[f"{index}.matrix"]
                read.append(placed(path, rows, matrix, field["path"]))
        moves = "yes; these are its splats at the first time" if about["moves"] else "no"
        return SplatFile(
            Splats.cat([splats for splats, _ in read]),
            antialiased=about["gsfw"].get("antialiased") is True,
            up=up,
            properties={
                "sets of splats": str(len(read)),
                "moves": moves,
                "unit": f"{about['unit']:g} m",
            },
            num_dropped=sum(dropped for _, dropped in read),
        )


@contextmanager
def _read_stage(path: Path) -> Iterator[Arrays]:
    """The values of the fields of a file, as ``stage_reader`` writes them.

    Raises:
        DataError: it cannot be read, or is damaged.
    """
    with readable(path):
        size = path.stat().st_size
        path.open("rb").close()
    with unpacked(path) as stage, TemporaryDirectory(prefix="gsfw-usd-") as folder:
        out = Path(folder) / "fields.npz"
        command = [sys.executable, "-m", stage_reader.__name__]
        asked = json.dumps([str(stage), str(out)]).encode()
        seconds = LEAST_SECONDS + size / BYTES_A_SECOND
        try:
            subprocess.run(command, input=asked, capture_output=True, timeout=seconds, check=True)
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
            raise DataError(
                f"{path} is a damaged file of USD, or refers to a file that is missing or damaged.",
                COPY_AGAIN,
            ) from None
        with np.load(out, allow_pickle=False) as arrays:
            yield arrays


def _check(path: Path, about: Mapping[str, Any]) -> None:
    """Check what a file has.

    Raises:
        DataError: it has no splats, or too many for its size, or a degree that is not read.
    """
    if not about["fields"]:
        raise DataError(
            f"{path} contains no splats: none of its prims is a ParticleField3DGaussianSplat.",
            "Export it as splats with OpenUSD 26.03 or later from the tool that made it.",
        )
    if not about["is_justified"]:
        raise DataError(
            f"{path} announces {about['total']} splats, which its size does not justify.",
            COPY_AGAIN,
        )
    for field in about["fields"]:
        if not 0 <= field["degree"] <= MAX_DEGREE:
            raise DataError(
                f"{path}: {field['path']} has colours of SH degree {field['degree']}; degrees 0 to "
                f"{MAX_DEGREE} are read.",
                "Export it with a lower degree from the tool that made it.",
            )


def _world(about: Mapping[str, Any]) -> tuple[str, Matrix]:
    """The upward direction in the world of the data, and the transform from the stage to it.

    A world with z up has the axes of the stage. In one with y up, y is turned down, as COLMAP's
    leads and files of splats expect; gsfw states the world that it has turned.
    """
    is_y_up = about["up_axis"] == "Y"
    up = stated_axis(about["gsfw"].get("up", "-y" if is_y_up else "z"))
    matrix = np.eye(4)
    if is_y_up:
        matrix[:3, :3] = turned_to_y(up).T.numpy()
    return up, matrix


def _stored_rows(path: Path, index: int, field: Mapping[str, Any], arrays: Arrays) -> StoredRows:
    """The values of a field.

    By the schema, positions tell the number of Gaussians; of longer arrays, the first values count,
    and shorter ones count as missing.
    """
    means = arrays[f"{index}.positions"].reshape(-1, 3).astype(np.float64)
    count, each = len(means), num_coefficients(field["degree"])

    def known(name: str, missing: list[float], rows: int = count) -> Float64[np.ndarray, "n width"]:
        found = arrays[f"{index}.{name}"].reshape(-1, len(missing))
        if len(found) < rows:
            return np.tile(np.array(missing), (rows, 1))
        return found[:rows].astype(np.float64)

    with np.errstate(over="ignore", invalid="ignore"):
        colors = known("coefficients", [0.0] * 3, count * each).astype(np.float32)
        colors = colors.reshape(count, each, 3)
        turned = np.roll(known("orientations", [0.0, 0.0, 0.0, 1.0]), 1, axis=1)
        return StoredRows(
            means=means,
            logits=logits_of(known("opacities", [1.0])[:, 0]),
            log_scales=log_scales_of(known("scales", [1.0] * 3)),
            quats=turned.astype(np.float32),
            dc=colors[:, 0],
            rest=colors[:, 1:],
        )
