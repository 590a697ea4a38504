"""Splats: activated Gaussians at one instant, the only input of a rasterizer besides cameras."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.maths.ragged import row_offsets, value_indices, value_rows
from gsfw.core.maths.spherical_harmonics import num_coefficients
from gsfw.core.numerics import MAX_LOG_SCALE


@dataclass(frozen=True)
class Sh:
    """Spherical-harmonic colours, dense or ragged (each splat its own degree).

    Colour = max(0, 0.5 + sum of coefficient times basis) in the direction from the camera
    centre to the mean.
    """

    coefficients: Float[Tensor, "n k 3"]
    """k = 1, 4, 9, 16 or 25; 1 (the constant coefficient) when the others are in ``rest``."""
    degree: int
    """Bands above this are ignored (the degree schedule); 0 to 4."""
    rest: Float[Tensor, "n k_minus_1 3"] | Float[Tensor, "m 3"] | None = None
    """All coefficients but the constant one, as models store them: dense, or, with ``offsets``,
    each splat's own 0, 3, 8, 15 or 24, concatenated; ``None`` when ``coefficients`` has them."""
    offsets: Int[Tensor, " n_plus_1"] | None = None
    """Ragged form: splat i has rows offsets[i] to offsets[i + 1] of ``rest``; else ``None``."""

    @property
    def width(self) -> int:
        """Number of coefficients of the widest row, k; counted over all rows if ragged."""
        if self.rest is None:
            return self.coefficients.shape[1]
        if self.offsets is None:
            return 1 + self.rest.shape[1]
        return 1 + (int(self.offsets.diff().max()) if len(self.offsets) > 1 else 0)

    def tensors(self) -> dict[str, Tensor]:
        """The differentiable tensors: the coefficients, and ``rest`` if present."""
        return {"colors": self.coefficients} | ({} if self.rest is None else {"rest": self.rest})

    def map(self, function: Callable[[Tensor], Tensor]) -> Sh:
        """Apply ``function`` to the tensors of coefficients."""
        rest = None if self.rest is None else function(self.rest)
        return replace(self, coefficients=function(self.coefficients), rest=rest)

    def dense(self) -> Float[Tensor, "n k 3"]:
        """The coefficients of the active degree; zero if a splat has none.

        Differentiable; k = (degree + 1) squared, or fewer if dense rows have no more.
        """
        count = num_coefficients(self.degree)
        if self.rest is None:
            return self.coefficients[:, :count]
        if self.offsets is None:
            return torch.cat([self.coefficients, self.rest[:, : count - 1]], dim=1)
        columns = torch.arange(count - 1, device=self.offsets.device)
        present = columns < self.offsets.diff()[:, None]
        source = (self.offsets[:-1, None] + columns)[present]
        padded = self.rest.new_zeros(len(self.coefficients) * (count - 1), 3)
        # By whole rows: the backward pass of indexing by masks or tensors sorts.
        padded = padded.index_copy(
            0, present.flatten().nonzero()[:, 0], self.rest.index_select(0, source)
        )
        padded = padded.view(len(self.coefficients), count - 1, 3)
        return torch.cat([self.coefficients, padded], dim=1)

    def of_degrees(self, degrees: Int[Tensor, " n"]) -> Sh:
        """Convert to the ragged form: each splat has the coefficients of its own degree only.

        Args:
            degrees: degree of each splat; at most the active one.
        """
        dense, lengths = self.dense(), (degrees + 1) ** 2 - 1
        present = torch.arange(dense.shape[1] - 1, device=lengths.device) < lengths[:, None]
        return Sh(dense[:, :1], self.degree, dense[:, 1:][present], row_offsets(lengths))

    def up_to(self, degree: int) -> Sh:
        """The colours without the bands above a degree; dense rows share memory with these."""
        if self.degree <= degree:
            return self
        count = num_coefficients(degree)
        if self.rest is None:
            return Sh(self.coefficients[:, :count], degree)
        if count == 1:
            return Sh(self.coefficients, degree)
        if self.offsets is None:
            return Sh(self.coefficients, degree, self.rest[:, : count - 1])
        lengths = self.offsets.diff().clamp_max(count - 1)
        rest = self.rest.index_select(0, value_indices(self.offsets[:-1], lengths))
        return Sh(self.coefficients, degree, rest, row_offsets(lengths))

    @staticmethod
    def cat(parts: Sequence[Sh]) -> Sh:
        """The colours of several sets, one after the other, of the highest of their degrees.

        Sets of one form keep it; dense ones get zeros for the bands that others have.
        """
        degree = max(part.degree for part in parts)
        # Bands above the degree of a set are ignored, and must not be drawn at a higher one.
        parts = [
            part if part.degree == degree else replace(part, degree=degree).up_to(part.degree)
            for part in parts
        ]
        if len({(part.rest is None, part.offsets is None) for part in parts}) > 1:
            parts = [Sh(part.dense(), part.degree) for part in parts]
        constant = _padded([part.coefficients for part in parts])
        rests = [part.rest for part in parts if part.rest is not None]
        offsets = [part.offsets for part in parts if part.offsets is not None]
        if not offsets:
            return Sh(constant, degree, _padded(rests) if rests else None)
        lengths = torch.cat([part.diff() for part in offsets])
        return Sh(constant, degree, torch.cat(rests), row_offsets(lengths))

    def take(self, rows: Int[Tensor, " r"]) -> Sh:
        """The colours of some splats, in the order of ``rows``."""
        if self.rest is None or self.offsets is None:
            return self.map(lambda tensor: tensor.index_select(0, rows))
        lengths = self.offsets.diff()[rows]
        constant = self.coefficients.index_select(0, rows)
        rest = self.rest.index_select(0, value_indices(self.offsets[:-1][rows], lengths))
        return Sh(constant, self.degree, rest, row_offsets(lengths))


def _padded(parts: Sequence[Float[Tensor, "_ _ 3"]]) -> Float[Tensor, "n k 3"]:
    """Rows of coefficients, one set after the other, with zeros up to the widest."""
    width = max(part.shape[1] for part in parts)
    return torch.cat(
        [
            part
            if part.shape[1] == width
            else torch.nn.functional.pad(part, (0, 0, 0, width - part.shape[1]))
            for part in parts
        ]
    )


def cat_colors(
    parts: Sequence[Sh | Float[Tensor, "_ d"]],
) -> Sh | Float[Tensor, "n d"]:
    """The colours of several sets of splats, one after the other.

    Raises:
        ValueError: some are SH colours, and others channels.
    """
    harmonics = [part for part in parts if isinstance(part, Sh)]
    channels = [part for part in parts if isinstance(part, Tensor)]
    if harmonics and channels:
        raise ValueError(
            "some of the splats have SH colours, and others channels; join splats of one kind"
        )
    return Sh.cat(harmonics) if harmonics else torch.cat(channels)


@dataclass(frozen=True)
class Splats:
    """``n`` activated Gaussians at one instant, with exactly one of the two forms of shape."""

    means: Float[Tensor, "n 3"]
    """Centres, in scene units."""
    opacities: Float[Tensor, " n"]
    """Opacities in [0, 1]; they include the temporal weight."""
    colors: Sh | Float[Tensor, "n d"]
    """View-dependent colour, or d channels that are rendered without a change."""
    quats: Float[Tensor, "n 4"] | None = None
    """Rotations, wxyz, of any norm: the rasterizer normalises them, differentiably."""
    scales: Float[Tensor, "n 3"] | None = None
    """Standard deviations along the rotated axes, in scene units, >= 0."""
    covariances: Float[Tensor, "n 3 3"] | None = None
    """The other form of shape: symmetric and positive semi-definite, in scene units squared."""
    extra: Float[Tensor, "n e"] | None = None
    """Further channels rendered in the same pass with background 0; ``None`` for none."""
    rows: Int[Tensor, " n"] | None = None
    """The model row of each splat if only some rows are present; ``None`` when splat i is row i."""

    def __len__(self) -> int:
        return self.means.shape[0]

    @property
    def channels(self) -> int:
        """Number of colour channels."""
        return 3 if isinstance(self.colors, Sh) else self.colors.shape[1]

    @property
    def sh_degree(self) -> int:
        """The active SH degree; 0 for channels, which do not depend on the direction."""
        return self.colors.degree if isinstance(self.colors, Sh) else 0

    def tensors(self) -> dict[str, Tensor]:
        """All floating-point tensors, by field name."""
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
        """Apply ``function`` to every tensor of ``tensors``."""

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

    def take(self, rows: Int[Tensor, " r"]) -> Splats:
        """Some of the splats, in the order of ``rows``; differentiable."""

        # The backward pass of indexing by a tensor sorts.
        def taken(tensor: Tensor) -> Tensor:
            return tensor.index_select(0, rows)

        drawn = None if self.rows is None else taken(self.rows)
        if not isinstance(self.colors, Sh):
            return replace(replace(self, rows=None).map(taken), rows=drawn)
        bare = replace(self, rows=None, colors=self.means).map(taken)
        return replace(bare, colors=self.colors.take(rows), rows=drawn)

    def held_by_float32(self) -> Bool[Tensor, " n"]:
        """The rows whose values, and logarithms of scales, files of float32 hold as finite ones."""
        held = torch.ones(len(self), dtype=torch.bool, device=self.means.device)
        if self.scales is not None:
            held &= (self.scales.log().float() <= MAX_LOG_SCALE).all(dim=1)
        named = self.tensors()
        rest = named.pop("rest", None)
        for values in named.values():
            held &= values.float().isfinite().reshape(len(self), -1).all(dim=1)
        if rest is not None:
            assert isinstance(self.colors, Sh)
            assert self.colors.offsets is not None
            owners = value_rows(self.colors.offsets.diff())
            held[owners[~rest.float().isfinite().all(dim=1)]] = False
        return held

    def up_to(self, degree: int) -> Splats:
        """The splats without SH bands above a degree (``Sh.up_to``); channels stay as they are."""
        colors = self.colors
        if not isinstance(colors, Sh) or colors.degree <= degree:
            return self
        return replace(self, colors=colors.up_to(degree))

    @staticmethod
    def cat(parts: Sequence[Splats]) -> Splats:
        """The splats of several sets, one after the other, with colours as of ``Sh.cat``.

        Fields that some sets have and others do not, such as ``rows``, are left out.

        Raises:
            ValueError: the sets differ in the form of their shapes, or in the kind of their
                colours.
        """
        if len(parts) == 1:
            return parts[0]
        if len({part.covariances is None for part in parts}) > 1:
            raise ValueError(
                "some of the splats have covariances, and others quaternions and scales; bring "
                "all into one form before joining them"
            )

        def joined(field: Callable[[Splats], Tensor | None]) -> Tensor | None:
            found = [tensor for tensor in map(field, parts) if tensor is not None]
            return torch.cat(found) if len(found) == len(parts) else None

        return Splats(
            means=torch.cat([part.means for part in parts]),
            opacities=torch.cat([part.opacities for part in parts]),
            colors=cat_colors([part.colors for part in parts]),
            quats=joined(lambda part: part.quats),
            scales=joined(lambda part: part.scales),
            covariances=joined(lambda part: part.covariances),
            extra=joined(lambda part: part.extra),
            rows=joined(lambda part: part.rows),
        )

    def to(self, device: torch.device | str) -> Splats:
        """Move the splats to another device; splats on the meta device stay there."""

        def moved(tensor: Tensor | None) -> Tensor | None:
            return tensor if tensor is None or tensor.is_meta else tensor.to(device)

        colors = self.colors
        splats = self.map(lambda tensor: tensor if tensor.is_meta else tensor.to(device))
        if isinstance(colors, Sh):
            assert isinstance(splats.colors, Sh)
            splats = replace(splats, colors=replace(splats.colors, offsets=moved(colors.offsets)))
        return replace(splats, rows=moved(self.rows))
