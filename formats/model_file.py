"""The model file of gsfw: a whole model, static or moving, that renders without its data set.

An archive of arrays with a header; docs/guides/model-file.md describes both. Reading one runs no
code of the file: it holds numbers and names, and its method has to be installed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.errors import ConfigError, DataError
from gsfw.core.exchange import Exporter, ExportSource, Holds, StoredModel
from gsfw.core.files.json_fields import BROKEN, JsonFields
from gsfw.core.loop.checkpoint_file import check_finite
from gsfw.formats.array_archive import ArrayArchive, read_archive, write_archive
from gsfw.formats.compact.half_precision import halved
from gsfw.formats.compact.state_reader import StateReader
from gsfw.formats.compact.state_writer import encode_model, num_filling
from gsfw.formats.model_header import CODED, STATE, read_header, write_header

ROWS, FILLING = "rows", "filling"
"""Arrays of compressed files: the positions of the rows, and zeros in files that need them."""


class Precision(Enum):
    """Precision of a model file."""

    FLOAT32 = "float32"
    FLOAT16 = "float16"
    COMPRESSED = "compressed"


@dataclass(frozen=True)
class ModelFileExporter(Exporter):
    """Writes a model file."""

    precision: Literal["float32", "float16", "compressed"] = "float32"
    """float32: everything, to the last bit. float16: half of the bytes, for about 0.001 dB.
    compressed: about a twentieth of them, entropy coded in steps."""
    step: float = 1.0
    """Size of all steps of precision=compressed, relative to the usual ones: twice as large saves
    4 to 5 bytes for each Gaussian. What it costs: gsfw tradeoff RUN."""

    suffix = ".gsfw"
    holds = Holds.MODEL
    levels = (
        {"precision": "float16"},
        *({"precision": "compressed", "step": step} for step in (0.5, 1.0, 2.0, 3.0)),
    )

    def __post_init__(self) -> None:
        known = [precision.value for precision in Precision]
        if self.precision not in known:
            raise ConfigError(
                f"format.precision={self.precision}: there is no such precision.",
                f"Precisions: {', '.join(known)}.",
            )
        if not 0.01 <= self.step <= 100:
            raise ConfigError(f"format.step={self.step:g}: expected a factor from 0.01 to 100.")
        if self.step != 1 and not self.is_compressed:
            raise ConfigError(
                f"format.step={self.step:g}: files in {self.precision} have no steps.",
                "Add format.precision=compressed, or leave format.step out.",
            )

    @property
    def is_compressed(self) -> bool:
        """True if values are stored in steps."""
        return self.precision == Precision.COMPRESSED.value

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically.

        Raises:
            OutputError: it cannot be written.
            ValueError: the model has state of a type that numpy lacks, or that is not finite.
        """
        model = source.stored_model()
        for name, tensor in model.state.items():
            if tensor.dtype == torch.bfloat16 or tensor.is_complex():
                raise ValueError(f"its {name} is of type {tensor.dtype}")
        check_finite(model.state)
        match Precision(self.precision):
            case Precision.FLOAT32:
                content = _plain(model)
            case Precision.FLOAT16:
                content = _halved(model)
            case Precision.COMPRESSED:
                content = self._compressed(model, source.contributions())
        write_archive(path, content)

    def _compressed(
        self, model: StoredModel, contributions: Float[Tensor, " n"] | None
    ) -> ArrayArchive:
        """The archive of a model; what contributes less is stored in larger steps."""
        encoded = encode_model(model, self.step, contributions)
        arrays = {ROWS: encoded.rows} if encoded.rows else {}
        arrays |= {STATE + name: held for name, held in encoded.tensors.items() if held}
        filling = num_filling(model, encoded)
        if filling:
            arrays[FILLING] = bytes(filling)
        return ArrayArchive(
            write_header(model, {"precision": self.precision, **encoded.document}),
            {name: np.frombuffer(held, np.uint8) for name, held in arrays.items()},
            short=True,
        )


def _plain(model: StoredModel) -> ArrayArchive:
    return ArrayArchive(write_header(model), _arrays(model.state))


def _halved(model: StoredModel) -> ArrayArchive:
    halves = halved(model)
    about = {"precision": Precision.FLOAT16.value, "halved": [STATE + name for name in halves]}
    return ArrayArchive(write_header(model, about), _arrays({**model.state, **halves}))


def _arrays(state: Mapping[str, Tensor]) -> dict[str, np.ndarray]:
    return {
        STATE + name: tensor.detach().cpu().contiguous().numpy() for name, tensor in state.items()
    }


def read_model_file(path: Path) -> StoredModel:
    """Read the model of a file.

    Raises:
        DataError: the file is missing, damaged, of a newer gsfw, or no model file.
    """
    archive = read_archive(path)
    model = read_header(path, archive.header, {})
    held = {
        name.removeprefix(STATE): array
        for name, array in archive.arrays.items()
        if name.startswith(STATE)
    }
    model = replace(model, state=_state(path, archive, model, held))
    for name, tensor in model.state.items():
        if tensor.is_floating_point() and not bool(tensor.isfinite().all()):
            raise DataError(f"{path}: {STATE}{name} holds values that are not finite.", BROKEN)
    for name, column in model.columns.items():
        for part in (column.values, column.offsets):
            if part is not None and part not in model.state:
                raise DataError(f"{path}: it has no {STATE}{part}, of column {name}.", BROKEN)
    return model


def _state(
    path: Path, archive: ArrayArchive, model: StoredModel, held: Mapping[str, np.ndarray]
) -> dict[str, Tensor]:
    """The tensors of a file, in the types of the model.

    Raises:
        DataError: it is in a precision that this gsfw does not know, or damaged.
    """
    if CODED not in archive.header:
        return {name: torch.from_numpy(array.copy()) for name, array in held.items()}
    fields = JsonFields(path, "", archive.header).fields(CODED)
    precision = fields.text("precision")
    if precision == Precision.COMPRESSED.value:
        rows = archive.arrays.get(ROWS, np.zeros(0, np.uint8)).tobytes()
        return StateReader(model, fields, rows, held).state(path.stat().st_size)
    if precision != Precision.FLOAT16.value:
        raise DataError(f"{path}: its precision is {precision!r}, which is unknown.", BROKEN)
    halves = set(fields.texts("halved"))
    return {
        name: torch.from_numpy(array.astype(np.float32) if STATE + name in halves else array.copy())
        for name, array in held.items()
    }


def read_model_header(path: Path) -> tuple[StoredModel, Mapping[str, Any]]:
    """Read a model without its state, and the plain header; the cost is independent of the rows.

    Raises:
        DataError: as ``read_model_file``.
    """
    header = read_archive(path, header_only=True).header
    return read_header(path, header, {}), header
