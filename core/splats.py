"""Splats: activated Gaussians at one instant, which is all that a rasterizer ever sees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor


@dataclass(frozen=True)
class Sh:
    """Spherical-harmonic colours, dense or ragged (each splat its own degree).

    Evaluated as max(0, 0.5 + sum of coefficient times basis) in the direction from the camera
    centre to the mean.
    """

    coefficients: Float[Tensor, "n k 3"] | Float[Tensor, "m 3"]
    """Dense [n, k, 3] with k = 1, 4, 9, 16 or 25; or, with ``offsets``, every splat's own
    coefficients one after the other."""
    degree: int
    """Bands above this are ignored (the degree schedule); 0 to 4."""
    offsets: Int[Tensor, " n_plus_1"] | None = None
    """Ragged form: splat i has coefficients offsets[i] to offsets[i + 1]; ``None`` when dense."""
    rest: Float[Tensor, "n k_minus_1 3"] | None = None
    """Dense form in two parts, as models keep them: all but the constant coefficient, which alone
    is in ``coefficients`` then; ``None`` when they are together."""

    @property
    def width(self) -> int:
        """Coefficients that a dense row has room for, k."""
        return self.coefficients.shape[1] + (0 if self.rest is None else self.rest.shape[1])

    def tensors(self) -> dict[str, Tensor]:
        """What can be differentiated: the coefficients, and ``rest`` if it is there."""
        return {"colors": self.coefficients} | ({} if self.rest is None else {"rest": self.rest})

    def map(self, function: Callable[[Tensor], Tensor]) -> Sh:
        """The same with ``function`` applied to the tensors of coefficients."""
        rest = None if self.rest is None else function(self.rest)
        return replace(self, coefficients=function(self.coefficients), rest=rest)

    def dense(self) -> Float[Tensor, "n k 3"]:
        """The coefficients of the active degree, zero where a splat has none.

        Differentiable; k = (degree + 1) squared.
        """
        count = (self.degree + 1) ** 2
        if self.rest is not None:
            return torch.cat([self.coefficients, self.rest[:, : count - 1]], dim=1)
        if self.offsets is None:
            return self.coefficients[:, :count]
        lengths = self.offsets.diff()
        columns = torch.arange(count, device=lengths.device)
        present = columns < lengths[:, None]
        padded = self.coefficients.new_zeros(len(lengths), count, 3)
        source = (self.offsets[:-1, None] + columns)[present]
        return padded.masked_scatter(present[:, :, None], self.coefficients[source])


@dataclass(frozen=True)
class Splats:
    """``n`` activated Gaussians at one instant. Exactly one of the two forms of shape is given."""

    means: Float[Tensor, "n 3"]
    """Centres, in scene units."""
    opacities: Float[Tensor, " n"]
    """In [0, 1]; a temporal weight is already in them."""
    colors: Sh | Float[Tensor, "n d"]
    """View-dependent colour, or d channels drawn as they are."""
    quats: Float[Tensor, "n 4"] | None = None
    """Rotations, wxyz, of any norm: the rasterizer normalises, with gradient through that."""
    scales: Float[Tensor, "n 3"] | None = None
    """Standard deviations along the rotated axes, in scene units, >= 0."""
    covariances: Float[Tensor, "n 3 3"] | None = None
    """The other form: symmetric and positive semi-definite, in scene units squared."""
    extra: Float[Tensor, "n e"] | None = None
    """Further channels drawn in the same pass with background 0; ``None`` for none."""
    rows: Int[Tensor, " n"] | None = None
    """The model row of each splat when only some are present; ``None`` when splat i is row i."""

    def __len__(self) -> int:
        return self.means.shape[0]

    @property
    def channels(self) -> int:
        """Number of colour channels."""
        return 3 if isinstance(self.colors, Sh) else self.colors.shape[1]

    def tensors(self) -> dict[str, Tensor]:
        """Every floating-point tensor that is present, by field name."""
        named: dict[str, Tensor | None] = {
            "means": self.means,
            "opacities": self.opacities,
            **(self.colors.tensors() if isinstance(self.colors, Sh) else {"colors": self.colors}),
            "quats": self.quats,
            "scales": self.scales,
            "covariances": self.covariances,
            "extra": self.extra,
        }
        return {name: tensor for name, tensor in named.items() if tensor is not None}

    def map(self, function: Callable[[Tensor], Tensor]) -> Splats:
        """The same with ``function`` applied to every tensor of ``tensors``."""

        def apply(tensor: Tensor | None) -> Tensor | None:
            return None if tensor is None else function(tensor)

        colors = self.colors
        return replace(
            self,
            means=function(self.means),
            opacities=function(self.opacities),
            colors=colors.map(function) if isinstance(colors, Sh) else function(colors),
            quats=apply(self.quats),
            scales=apply(self.scales),
            covariances=apply(self.covariances),
            extra=apply(self.extra),
        )
