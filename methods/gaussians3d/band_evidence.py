"""BandEvidence: gradients that show the need of Gaussians for spherical-harmonic bands.

The views of a Gaussian with a direction-dependent colour have different colour gradients. With g_v
the gradient of the loss of view v with respect to the Gaussian's colour, and Y_k the functions of
the band that it lacks, the missing coefficients would get the gradient

    T_k = sum over views of g_v Y_k(direction of v),

which needs no such coefficient: g_v follows from the gradient of the constant one. If g is
independent of the direction, the variance of T_k is the sum of (g_v Y_k)^2, so that

    sum over k of T_k^2  /  sum over k and v of (g_v Y_k)^2

is 1 on average, whatever the scene, the loss and the number of views: any excess is signal.

The use of an existing band for the image follows from the same gradients: the loss is mostly an
absolute difference, so the sum of |g_v| is about proportional to the Gaussian's alpha times
transmittance over all pixels, which is the weight of an error of its colour.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn.functional import normalize

from gsfw.core.column import Column, Layout, Rows
from gsfw.core.context import StepContext
from gsfw.core.maths.ragged import value_rows
from gsfw.core.maths.spherical_harmonics import C0, sh_basis
from gsfw.core.splats import Sh, Splats

LARGEST = 1e15
"""Upper bound of gradients; their squares can be summed in float32."""


class BandEvidence(nn.Module):
    """Two columns without learning rates, which density control edits like any other.

    ``band_evidence``, ragged: while evidence is gathered, rows that may get another band have one
    value [2, 3] for each of its coefficients: by channel, the sum T_k, and the sum of the squares.
    At all other times, and for rows of the highest degree, there are none.
    ``band_weights``: the sum of |g_v| of each row over the views since the last round.
    """

    def __init__(self, count: int) -> None:
        super().__init__()
        offsets = torch.zeros(count + 1, dtype=torch.int64)
        self.sums = Column(torch.zeros(0, 2, 3), layout=Layout.RAGGED, offsets=offsets)
        self.weights = Column(torch.zeros(count))

    def columns(self) -> dict[str, Column]:
        """Both columns by name."""
        return {"band_evidence": self.sums, "band_weights": self.weights}

    def new_rows(self, count: int) -> dict[str, Rows]:
        """Values of the columns for new rows, which have no evidence."""
        weights = self.weights.values.new_zeros(count)
        return {
            "band_evidence": Rows(self.sums.values[:0], weights.long()),
            "band_weights": Rows(weights),
        }

    def watch(self, context: StepContext, degrees: Int[Tensor, " n"]) -> None:
        """Record the gradients of a rendered batch in its backward pass.

        Splats without a graph are ignored.

        Args:
            context: context of the batch.
            degrees: degrees of the model's rows.
        """
        colors = context.splats.colors
        if not isinstance(colors, Sh) or not colors.coefficients.requires_grad:
            return

        def note(gradient: Tensor) -> None:
            handle.remove()  # A parameter that is rendered without a change would keep its hook.
            pull = gradient.detach()[:, 0] / C0
            # A step that is not finite adds nothing; the optimizer skips it as well.
            pull = torch.where(pull.isfinite().all(), pull, 0.0).clamp(-LARGEST, LARGEST)
            self._weigh(pull, context.splats)
            self._add(pull, context, degrees)

        handle = colors.coefficients.register_hook(note)

    @torch.no_grad()
    def _weigh(self, pull: Float[Tensor, "s 3"], splats: Splats) -> None:
        weights, strength = self.weights.values, pull.abs().sum(1).to(self.weights.values)
        if splats.rows is None:
            weights.add_(strength)
        else:
            weights.index_add_(0, splats.rows, strength)

    @torch.no_grad()
    def _add(
        self, pull: Float[Tensor, "s 3"], context: StepContext, degrees: Int[Tensor, " n"]
    ) -> None:
        """Add to the sums of rows that exactly one camera of the batch has seen.

        If several cameras see a splat, only the sum of their gradients is known.
        """
        if len(self.sums.values) == 0:
            return
        splats, visible = context.splats, context.rendered.statistics.visible
        offsets = self.sums.offsets
        assert offsets is not None
        seen = (visible.sum(0) == 1).nonzero()[:, 0]
        rows = seen if splats.rows is None else splats.rows[seen]
        gathering = offsets.diff()[rows] > 0
        seen, rows = seen[gathering], rows[gathering]
        centers = context.batch.cameras.centers[visible[:, seen].to(torch.uint8).argmax(0)]
        directions = normalize(splats.means.detach()[seen] - centers, dim=1)
        of_rows = degrees[rows]
        for degree in of_rows.unique().tolist():
            some = (of_rows == degree).nonzero()[:, 0]
            basis = sh_basis(degree + 1, directions[some])[:, (degree + 1) ** 2 :]
            terms = basis[:, :, None] * pull[seen[some], None]
            places = offsets[rows[some], None] + torch.arange(basis.shape[1], device=rows.device)
            both = torch.stack([terms, terms.square()], dim=2).to(self.sums.values)
            self.sums.values.index_add_(0, places.flatten(), both.flatten(0, 1))

    def needed(self, signal: float) -> Bool[Tensor, " n"]:
        """True for rows that need their missing band; false without evidence.

        Args:
            signal: the ratio above which a row needs the band; 1 is noise.
        """
        offsets = self.sums.offsets
        assert offsets is not None
        lengths = offsets.diff()
        owners = value_rows(lengths)
        sums, squares = self.sums.values.double().unbind(1)
        totals = sums.new_zeros(2, len(lengths))
        totals[0].index_add_(0, owners, sums.square().sum(1))
        totals[1].index_add_(0, owners, squares.sum(1))
        return totals[0] > signal * totals[1]

    def forget_(self) -> None:
        """Reset the weights."""
        self.weights.values.zero_()
