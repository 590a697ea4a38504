"""EditableModel: a static or moving model, edited by rows, by its place, and by its colours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.column import Column, Layout, Rows
from gsfw.core.contributions import Contributions
from gsfw.core.errors import ConfigError
from gsfw.core.maths.frame import with_axes
from gsfw.core.maths.similarity import Similarity
from gsfw.core.maths.spherical_harmonics import num_coefficients
from gsfw.core.model import PrimitiveModel
from gsfw.core.numerics import FAINTEST
from gsfw.core.splats import Sh, Splats
from gsfw.editing.capture import Capture
from gsfw.editing.colors import ColorMap
from gsfw.editing.editable import Editable, Test, to_world
from gsfw.editing.transforms import composed, up_after

CONSTANT, OTHERS = "sh_dc", "sh_rest"
"""Columns of SH coefficients: the constant one, and all others."""
COLOR_ERROR = 1e-3
"""Largest error of a coefficient after a change of the columns, relative to the largest."""
AS_FILE = "Write a splat format instead, at one time: out=FILE.ply time=0.5"


@dataclass(frozen=True)
class EditableModel(Editable):
    """A model at all its times. Its parameters are changed in place: nobody else uses it.

    Transforms change no parameter: they change the world around the scene frame.
    """

    model: PrimitiveModel
    method: str
    """Name of the method, for messages."""
    given: Capture
    """The capture."""
    times: tuple[float, ...]
    """Times at which rows are tested, in [0, 1]; one for a static model."""
    at_all_times: bool
    """True if a moving row has to pass a test at all times at which it can be seen."""
    time: float
    """Time of ``splats``."""
    moved: Similarity
    up: str
    in_place: ClassVar[bool] = True

    def __len__(self) -> int:
        return self.model.num_rows

    @property
    def degree(self) -> int:
        """SH degree of the colours."""
        return self._at(self.time).sh_degree

    def capture(self) -> Capture:
        """The cameras of the training."""
        return self.given

    def _time(self, time: float) -> Float[Tensor, ""]:
        return torch.tensor(time, device=self.given.device)

    @torch.no_grad()
    def _at(self, time: float, camera: Cameras | None = None) -> Splats:
        return self.model.splats(self._time(time), camera).map(torch.Tensor.detach)

    def splats(self) -> Splats:
        """The splats of one time in the world of now."""
        return with_axes(to_world(self._at(self.time), self.world_from_scene()))

    def scene_splats(self) -> Splats:
        """The splats of one time in the scene frame, as they are rendered."""
        return self._at(self.time)

    def as_file(self) -> None:
        """Nothing: its run stores it."""

    def file_bytes(self, num_bytes: Callable[[Editable], int]) -> tuple[float, float]:
        """Bytes by the size of its file and those of the columns."""
        total = num_bytes(self)
        each = min(self.row_bytes(), total / len(self))  # Bands of zeros are not written.
        return max(total - each * len(self), 0.0), each

    def chosen(self, test: Test, ever: bool = False) -> Bool[Tensor, " n"]:
        """The rows that pass a test at any of the times, or at all of them, when they are seen."""
        passed = torch.zeros(len(self), dtype=torch.bool)
        failed = torch.zeros(len(self), dtype=torch.bool)
        world = self.world_from_scene()
        for time in self.times:
            splats = self._at(time)
            rows = torch.arange(len(self)) if splats.rows is None else splats.rows.cpu()
            found = with_axes(to_world(splats, world))
            seen = found.opacities >= FAINTEST
            tested = torch.ones_like(seen) if ever or len(self.times) == 1 else seen
            passes = test(found)
            passed[rows] |= passes & tested
            failed[rows] |= ~passes & tested
        return passed & ~failed if self.at_all_times and not ever else passed

    def contributions(self) -> Contributions:
        """Measure the contributions of each row to the training views, each at its time."""
        return self.given.contributions(self.model.splats, len(self))

    def keep(self, rows: Bool[Tensor, " n"]) -> EditableModel:
        """Leave out all other rows, of every column."""
        kept = rows.nonzero()[:, 0].to(self.given.device)
        taken = {name: column.take(kept) for name, column in self.model.columns().items()}
        for name, column in self.model.columns().items():
            column.assign(taken[name])
        return self

    def with_splats(self, splats: Splats) -> EditableModel:
        """Raise an error: splats are no rows of a model.

        Raises:
            ConfigError: always.
        """
        raise ConfigError("the rows of a model can only be left out, not replaced.", AS_FILE)

    def transformed(self, similarity: Similarity) -> EditableModel:
        """Change the world; the scene frame, its cameras and all parameters stay."""
        moved = composed(similarity, self.moved)
        return replace(self, moved=moved, up=up_after(self.up, similarity))

    def with_up(self, axis: str) -> EditableModel:
        """State the upward direction."""
        return replace(self, up=axis)

    @torch.no_grad()
    def recolored(self, change: ColorMap) -> EditableModel:
        """Change the columns of colours, and check that all colours follow.

        Raises:
            ConfigError: they do not, as the method makes colours of more than these columns.
        """
        columns = self.model.columns()
        before = [self._coefficients(time) for time in self.times]
        if CONSTANT not in columns or None in before or self._decodes():
            raise self._refused()
        constant, others = columns[CONSTANT], columns.get(OTHERS)
        constant.assign(Rows(change.constant(constant.values)))
        if others is not None:
            others.assign(_rows(others, change.others(others.values)))
        for time, old in zip(self.times, before, strict=True):
            new = self._coefficients(time)
            assert old is not None
            assert new is not None
            expected = torch.cat([change.constant(old[:, :1]), change.others(old[:, 1:])], dim=1)
            allowed = COLOR_ERROR * float(expected.abs().max()) if len(expected) else 0.0
            if bool(((new - expected).abs() > allowed).any()):
                raise self._refused()
        return self

    def row_bytes(self) -> float:
        """Bytes of a row in all columns, on average."""
        total = sum(column.values.nbytes for column in self.model.columns().values())
        return max(total / max(len(self), 1), 1.0)

    def can_refit(self) -> bool:
        """True for a static model whose constant colours are a column, the same for all views."""
        is_still = len(self.times) == 1 and CONSTANT in self.model.columns()
        is_still = is_still and not self.model.depends_on_view
        return is_still and isinstance(self._at(self.time).colors, Sh) and not self._decodes()

    @torch.no_grad()
    def with_constants(self, dc: Float[Tensor, "n 3"]) -> EditableModel:
        """Replace the constant coefficients."""
        self.model.columns()[CONSTANT].assign(Rows(dc[:, None]))
        return self

    def _coefficients(self, time: float) -> Float[Tensor, "n k 3"] | None:
        """Coefficients of the first view's colours at a time; ``None`` for colours of no SH."""
        found = self._at(time, self.given.cameras[0].to(self.given.device)).colors
        return found.dense().detach().clone() if isinstance(found, Sh) else None

    def _decodes(self) -> bool:
        """True if rendered channels are not colours yet."""
        if type(self.model).decode is PrimitiveModel.decode:
            return False
        small = self.given.cameras[0].resized(8, 8).to(self.given.device)
        splats = self._at(self.time, small)
        output = self.given.rasterizer.render(splats, small, self.given.settings)
        return self.model.decode(output, small) is not output

    def _refused(self) -> ConfigError:
        return ConfigError(
            f"method {self.method} makes its colours of more than the columns {CONSTANT} and "
            f"{OTHERS}, so that they cannot be changed in a model file.",
            AS_FILE,
        )

    @torch.no_grad()
    def truncated(self, degree: int) -> EditableModel:
        """Leave out the SH bands above a degree: shorter ragged rows, zeros in dense ones.

        Raises:
            ConfigError: the model has no such column.
        """
        count = num_coefficients(degree) - 1
        column = self.model.columns().get(OTHERS)
        if column is None:
            if self.degree > degree:
                raise self._refused()
            return self
        if column.offsets is not None:
            column.assign(column.resized(column.offsets.diff().clamp_max(count)))
        else:
            values = column.values.detach().clone()
            values[:, count:] = 0.0
            column.assign(Rows(values))
        return self


def _rows(column: Column, values: Tensor) -> Rows:
    """Values in the layout of a column."""
    if column.layout is Layout.RAGGED:
        assert column.offsets is not None
        return Rows(values, column.offsets.diff())
    return Rows(values)
