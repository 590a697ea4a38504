"""The model file of gsfw: a whole model, static or moving, that renders without its data set.

An archive of arrays with a header; docs/guides/model-file.md describes both. Reading one runs no
code of the file: it holds numbers and names, and its method has to be installed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.core.exchange import Exporter, ExportSource, Holds, StoredModel
from gsfw.core.loop.run_folder import check_finite
from gsfw.formats.array_archive import ArrayArchive, read_archive, write_archive
from gsfw.formats.header_fields import BROKEN
from gsfw.formats.model_header import STATE, read_header, write_header


class ModelFileExporter(Exporter):
    """Writes a model file."""

    suffix = ".gsfw"
    holds = Holds.MODEL

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically.

        Raises:
            OutputError: it cannot be written.
            ValueError: the model has state of a type that numpy lacks, or that is not finite.
        """
        model = source.stored_model()
        arrays: dict[str, np.ndarray] = {}
        for name, tensor in model.state.items():
            if tensor.dtype == torch.bfloat16 or tensor.is_complex():
                raise ValueError(f"its {name} is of type {tensor.dtype}")
            arrays[STATE + name] = tensor.detach().cpu().contiguous().numpy()
        check_finite(model.state)
        write_archive(path, ArrayArchive(write_header(model), arrays))


def read_model_file(path: Path) -> StoredModel:
    """Read the model of a file.

    Raises:
        DataError: the file is missing, damaged, of a newer gsfw, or no model file.
    """
    archive = read_archive(path)
    state = {
        name.removeprefix(STATE): _tensor(path, name, array)
        for name, array in archive.arrays.items()
        if name.startswith(STATE)
    }
    model = read_header(path, archive.header, state)
    for name, column in model.columns.items():
        for part in (column.values, column.offsets):
            if part is not None and part not in state:
                raise DataError(f"{path}: it has no {STATE}{part}, of column {name}.", BROKEN)
    return model


def _tensor(path: Path, name: str, array: np.ndarray) -> Tensor:
    tensor = torch.from_numpy(array.copy())
    if tensor.is_floating_point() and not bool(tensor.isfinite().all()):
        raise DataError(f"{path}: {name} holds values that are not finite.", BROKEN)
    return tensor


def read_model_header(path: Path) -> tuple[StoredModel, Mapping[str, Any]]:
    """Read a model without its state, and the plain header; the cost is independent of the rows.

    Raises:
        DataError: as ``read_model_file``.
    """
    header = read_archive(path, header_only=True).header
    return read_header(path, header, {}), header
