"""Edits: fewer rows, SH bands or bits, faint splats left out, and rows that become static."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.model import PrimitiveModel
from gsfw.core.splats import Sh, Splats
from gsfw.studies.tradeoff.storage import Cut, Storage
from gsfw.studies.tradeoff.subject import Subject


@dataclass(frozen=True)
class Kept(Cut):
    """Leaves out every splat but those of some rows."""

    rows: Int[Tensor, " m"]

    def __call__(self, splats: Splats, camera: Cameras | None = None) -> Splats:
        """The splats of these rows, as far as they are among the given ones."""
        if splats.rows is None:
            return splats.take(self.rows)
        return splats.take(torch.isin(splats.rows, self.rows).nonzero()[:, 0])

    def left_of(self, storage: Storage) -> Storage:
        """The storage of these rows, and everything that belongs to no row."""
        return storage.of_rows(self.rows)


@dataclass(frozen=True)
class ShTruncation(Cut):
    """Leaves out every SH band above a degree."""

    degree: int

    def __call__(self, splats: Splats, camera: Cameras | None = None) -> Splats:
        """The splats with colours of at most this degree; plain channels are unchanged."""
        colors = splats.colors
        if not isinstance(colors, Sh) or colors.degree <= self.degree:
            return splats
        # In memory of their own: what is measured then reads nothing of the bands above.
        left = colors.up_to(self.degree).map(torch.Tensor.contiguous)
        return replace(splats, colors=left)

    def left_of(self, storage: Storage) -> Storage:
        """The storage without the coefficients of the upper bands."""
        return storage.up_to_degree(self.degree)


TYPES = {"fp16": torch.float16, "bf16": torch.bfloat16}
"""Smaller types by their usual names; the unchanged model has fp32."""


def rounded(name: str) -> Callable[[Subject], Subject]:
    """A change that stores all parameters in a type and reads them back."""
    dtype = TYPES[name]

    def change(subject: Subject) -> Subject:
        model = rounded_model(subject.model, dtype)
        return replace(subject, model=model, float_bytes=dtype.itemsize)

    return change


def rounded_model(model: PrimitiveModel, dtype: torch.dtype) -> PrimitiveModel:
    """A copy of a model whose numbers, before activation, are rounded to ``dtype``.

    Numbers that are too large for the type become infinite; rendering then names their field.
    """
    copy = deepcopy(model)
    state = {
        name: tensor.to(dtype).to(tensor.dtype) if tensor.is_floating_point() else tensor
        for name, tensor in model.state_dict().items()
    }
    copy.load_state_dict(state)
    return copy


@dataclass(frozen=True)
class TemporalCulling:
    """Leaves out, at each time, splats that are fainter then; the storage is unchanged."""

    opacity: float
    """The least opacity that is rendered, in [0, 1]."""

    def __call__(self, splats: Splats, camera: Cameras | None = None) -> Splats:
        """The splats that are opaque enough, in the same order."""
        drawn = splats.opacities >= self.opacity
        return splats.take(drawn.nonzero()[:, 0])


INSTANTS = 9
"""Number of times, spread evenly over the sequence, at which positions are compared."""
MIDDLE = 0.5
"""Time whose appearance static rows keep."""
THERE = 0.5
"""Part of a row's largest opacity; at times when it is fainter, the row is absent."""


@torch.no_grad()
def by_motion(subject: Subject, cameras: Sequence[Cameras]) -> Int[Tensor, " n"]:
    """Rows of a model in the order of their motion, the least first.

    Motion is the largest distance from the position in the middle of the sequence. Rows that are
    absent at some of the times come last, in the order of the number of these times. If the splats
    of the model depend on the view, both are the largest for any camera.

    Args:
        subject: the model.
        cameras: views of it; at least one.
    """
    views = cameras if subject.model.depends_on_view else [None]
    seen = [_motion(subject, camera) for camera in views]
    distances, absences = (torch.stack(values).amax(0) for values in zip(*seen, strict=True))
    order = distances.argsort(stable=True)
    return order[absences[order].argsort(stable=True)]


def _motion(
    subject: Subject, camera: Cameras | None
) -> tuple[Float[Tensor, " n"], Int[Tensor, " n"]]:
    """Motion of each row for a camera, and the number of times at which it is absent."""
    device = next(iter(subject.model.columns().values())).values.device
    times = torch.linspace(0.0, 1.0, INSTANTS, device=device)
    found = [_everywhere(subject.splats(time, camera), subject.model.num_rows) for time in times]
    means, opacities = (torch.stack(values) for values in zip(*found, strict=True))
    there = (opacities > 0) & (opacities >= THERE * opacities.amax(0))
    distances = (means - means[INSTANTS // 2]).norm(dim=2)
    return distances.where(there, 0.0).amax(0), (~there).sum(0)


def _everywhere(splats: Splats, count: int) -> tuple[Float[Tensor, "n 3"], Float[Tensor, " n"]]:
    """Position and opacity of each row; 0 for rows that are not rendered."""
    if splats.rows is None:
        return splats.means, splats.opacities
    means = splats.means.new_zeros(count, 3).index_copy(0, splats.rows, splats.means)
    return means, means.new_zeros(count).index_copy(0, splats.rows, splats.opacities)


@dataclass(frozen=True)
class StaticConversion(Cut):
    """Renders some rows at all times as they are in the middle of the sequence.

    Rows that are absent at that time are never rendered.
    """

    rows: Int[Tensor, " m"]
    """Rows that become static."""
    held: Callable[[Cameras | None], Splats]
    """Their splats at all times for a camera, in the order of rows."""

    @staticmethod
    def of(subject: Subject, rows: Int[Tensor, " m"]) -> StaticConversion:
        """Take some rows of a model as they are in the middle of the sequence."""

        def held(camera: Cameras | None) -> Splats:
            middle = subject.splats(torch.tensor(MIDDLE, device=rows.device), camera)
            return _chosen(middle, torch.isin(_rows(middle), rows))

        if subject.model.depends_on_view:
            return StaticConversion(rows, held)
        always = held(None)
        return StaticConversion(rows, lambda _: always)

    def __call__(self, splats: Splats, camera: Cameras | None = None) -> Splats:
        """The splats of a time in the order of rows; static rows have their held splats."""
        if not len(self.rows):
            return splats
        changing = _chosen(splats, ~torch.isin(_rows(splats), self.rows))
        everything = Splats.cat([changing, self.held(camera)])
        return everything.take(_rows(everything).argsort())

    def left_of(self, storage: Storage) -> Storage:
        """The storage without the time parameters of these rows."""
        return storage.without_time(self.rows)


def _rows(splats: Splats) -> Int[Tensor, " n"]:
    """The model row of each splat."""
    if splats.rows is not None:
        return splats.rows
    return torch.arange(len(splats), device=splats.means.device)


def _chosen(splats: Splats, mask: Bool[Tensor, " n"]) -> Splats:
    """The splats of a mask, with their rows."""
    return replace(splats, rows=_rows(splats)).take(mask.nonzero()[:, 0])
