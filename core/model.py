"""PrimitiveModel: trained parameters, and their splats at a given time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ClassVar

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from gsfw.core.cameras import Cameras
from gsfw.core.column import Column, Rows
from gsfw.core.operators import Operators
from gsfw.core.parameter_group import ParameterGroup
from gsfw.core.render_output import RenderOutput
from gsfw.core.splats import Splats

if TYPE_CHECKING:
    from gsfw.core.context import StepContext

POSITIONS = "means"
"""Name of the column of positions."""

Children = Mapping[str, Rows]
"""New rows for every column, by column name."""


class PrimitiveModel(nn.Module, ABC):
    """Trained parameters, and their splats at a given time.

    A model must have ``columns`` and ``splats``. Density control needs more: see
    ``DensifiableModel``. ``training`` is true from ``Method.prepare`` to the update of each step
    alone: dropout and noise that depend on it are absent from evaluations, views and exports.
    """

    divisible: ClassVar[bool] = True
    """False if the splats or terms of a row depend on other rows: the rows then cannot be divided
    among processes (shards=N)."""
    step_bytes: ClassVar[float] = 0.0
    """Memory of a Gaussian in a step besides its columns and its splats, such as the features of a
    network: a part of the estimate of memory."""
    depends_on_view: bool = False
    """True if ``splats`` differ between cameras: each view is then rendered with its own splats,
    and is a batch of its own in training. False lets views of one time share their splats."""

    @abstractmethod
    def columns(self) -> Mapping[str, Column]:
        """Every per-splat quantity, by name; all have the same number of rows."""

    @abstractmethod
    def splats(
        self, time: Float[Tensor, ""] | None = None, cameras: Cameras | None = None
    ) -> Splats:
        """The activated Gaussians.

        Args:
            time: in [0, 1]; ``None`` for a static capture, or for the first time. A static model
                ignores it.
            cameras: the cameras of the render; ``None`` where there is no view, as for exports.
                It is one camera (c = 1) if ``depends_on_view`` is true. Other models may choose
                what to return by ``None``, and ignore which cameras they are.
        """

    def temporal_columns(self) -> Mapping[str, Column]:
        """The columns that represent motion and change over time; none for a static model."""
        return {}

    def parameter_groups(self) -> tuple[ParameterGroup, ...]:
        """Trained parameters that do not belong to one splat (networks, grids)."""
        return ()

    def decode(self, output: RenderOutput, cameras: Cameras) -> RenderOutput:
        """Turn rendered channels into colours; models that render features decode them here."""
        return output

    def regularizers(self, context: StepContext) -> Mapping[str, Tensor]:
        """Weighted scalars to add to the loss, by name. No side effects."""
        return {}

    def active_bands(self) -> int | None:
        """Trained SH coefficients above the constant one; ``None`` when all are."""
        return None

    def project_(self) -> None:
        """Enforce norms, manifolds and minimum durations after an optimizer step. In place."""

    def summary(self) -> Mapping[str, int | float]:
        """Figures for the run's summary, by name: bytes of the parameters, and the model's own."""
        trained = [column.values for column in self.columns().values() if column.trained]
        groups = [tensor for group in self.parameter_groups() for tensor in group.parameters]
        return {"model_bytes": sum(tensor.nbytes for tensor in (*trained, *groups))}

    @property
    def num_rows(self) -> int:
        """Number of primitives.

        Raises:
            RuntimeError: a column is used before it is made. ``nn.Module`` would report a missing
                ``num_rows`` instead.
        """
        try:
            return next(iter(self.columns().values())).num_rows
        except AttributeError as error:
            raise RuntimeError(f"the columns of {type(self).__name__}: {error}") from error


class DensifiableModel(PrimitiveModel):
    """A model whose rows can be split, cloned, relocated and perturbed, *in model terms*.

    Density control knows no logits, logarithms or time parameters. A strategy whose ``needs()``
    has ``densifiable`` set works with these models only.
    """

    @abstractmethod
    def opacities(self) -> Float[Tensor, " n"]:
        """Opacity of each row in [0, 1], without a temporal weight; no gradient."""

    @abstractmethod
    def sizes(self) -> Float[Tensor, " n"]:
        """Largest standard deviation of each row, in scene units; no gradient."""

    def positions(self) -> Float[Tensor, "n 3"] | None:
        """Position of each row in the scene frame, without motion; ``None`` if there is no column.

        No gradient.
        """
        column = self.columns().get(POSITIONS)
        return None if column is None else column.values.detach()

    def lifetimes(self) -> Float[Tensor, " n"] | None:
        """Mean temporal weight of each row over [0, 1]; ``None`` when it is 1 for all rows."""
        return None

    def time_gradients(self) -> Float[Tensor, " n"] | None:
        """Gradient |dL / d temporal centre| of each row in the latest step, with time in [0, 1].

        ``None`` for a model whose rows have no temporal centre, or before any step.
        """
        return None

    @torch.no_grad()
    def clone_rows(
        self, rows: Int[Tensor, " r"], generator: torch.Generator | None = None
    ) -> Children:
        """Copies of ``rows``; with a ``generator`` their random parts may differ.

        A copy at the place and time of its original is redundant: a moving model may sample a new
        temporal centre for each.
        """
        return {name: column.take(rows) for name, column in self.columns().items()}

    @abstractmethod
    def split_rows(
        self, rows: Int[Tensor, " r"], copies: int, generator: torch.Generator
    ) -> Children:
        """Sample ``copies`` smaller children for each of ``rows`` from the row's own density.

        The children are ordered by number: the first child of every row, then the second ones.
        """

    @abstractmethod
    def rows_at(
        self,
        points: Float[Tensor, "r 3"],
        colors: Float[Tensor, "r 3"],
        sizes: Float[Tensor, " r"],
        time: float | None,
    ) -> Children:
        """New rows for badly reconstructed pixels: isotropic, with low opacity and no motion.

        Args:
            points: positions at ``time``, in scene units.
            colors: colours, in [0, 1].
            sizes: standard deviations, in scene units.
            time: in [0, 1]; a model with temporary rows centres them at it. ``None``
                for a static capture.
        """

    @abstractmethod
    def relocated(self, rows: Int[Tensor, " r"], counts: Int[Tensor, " r"]) -> Children:
        """``rows`` with opacity and scale such that ``counts`` coincident copies render as one did.

        Equation 9 of Kheradmand et al. 2024; counts >= 1 include the row itself.
        """

    @abstractmethod
    def perturb_(self, rate: float, generator: torch.Generator, operators: Operators) -> None:
        """Move positions by noise shaped by each row's covariance, strong where opacity is low.

        Equation 8 of Kheradmand et al. 2024; ``rate`` is the noise rate times the position's
        learning rate. ``operators`` are those of the model's device. In place.
        """

    @abstractmethod
    def change_opacities_(self, function: Callable[[Tensor], Tensor]) -> tuple[str, ...]:
        """Apply a function to every opacity, in place; the names of the columns that changed.

        Args:
            function: maps opacities in [0, 1] (float64) to opacities in (0, 1), element by
                element, such as ``lambda opacities: opacities.clamp_max(0.01)``. Rows that it
                does not change keep their bits.
        """
