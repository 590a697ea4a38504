"""StillRows: the static rows of a model, and the evidence that they should move.

A static row that should move has different gradients early and late in the sequence: those of
its position and opacity correlate with time, whatever their size. For a direction g of the gradient
and phi_k(t) = cos(k pi t), k = 1, 2, the sum of g phi_k over the steps has the variance
sum (g phi_k)^2 if g is independent of t, so that their quotient

    z = sum g phi_k / sqrt(sum (g phi_k)^2)

is a signal-to-noise ratio: it has mean 0 and deviation 1 for a row that needs no time, and is
independent of the units of scene and loss. A mean gradient, of a row that merely converges to its
position, adds nothing, since the phi_k have mean zero over the sequence.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from gsfw.core.column import Column, Layout, Rows
from gsfw.core.splats import Splats

FREQUENCIES = (1, 2)
"""Half-waves over the sequence, correlated with gradients: early or late, middle or ends."""
POSITION, OPACITY = slice(0, 3), slice(3, 4)
DIRECTIONS = 4
"""Three directions of the position, and the opacity."""
REMEMBERED = 0.9
"""Factor of earlier evidence from one round to the next: it spans ten intervals."""
LARGEST = 1e15
"""Upper bound of gradients; their squares can be summed in float32."""
FIRST_TERM = 4.0
"""Rounds for which a row keeps moving after its start: a shorter motion could not get far."""


class StillRows(nn.Module):
    """Two columns without learning rates, which density control edits like any other.

    ``stillness``, ragged: static rows have one value, the evidence
    [2, frequencies, directions] (the sums, and the sums of the squares); moving rows have none.
    ``terms``: rounds for which a row must keep moving, and their number after its next start,
    which doubles, so that no row alternates for long.
    """

    def __init__(self, count: int, all_still: bool) -> None:
        """Make ``count`` rows, all static or all moving."""
        super().__init__()
        still = count if all_still else 0
        evidence = torch.zeros(still, 2, len(FREQUENCIES), DIRECTIONS)
        offsets = torch.arange(count + 1) if all_still else torch.zeros(count + 1).long()
        self.stillness = Column(evidence, layout=Layout.RAGGED, offsets=offsets)
        self.terms = Column(torch.tensor([0.0, FIRST_TERM]).repeat(count, 1))
        self._sorted_by: Tensor | None = None
        self._sorts = 0
        self._still = self._moving = torch.zeros(0, dtype=torch.int64)

    def columns(self) -> dict[str, Column]:
        """Both columns by name."""
        return {"stillness": self.stillness, "terms": self.terms}

    def mask(self) -> Bool[Tensor, " n"]:
        """True for static rows."""
        assert self.stillness.offsets is not None
        return self.stillness.offsets.diff() > 0

    def rows(self) -> Int[Tensor, " s"]:
        """Static rows in order, which is the order of the evidence."""
        self._sort()
        return self._still

    def moving(self) -> Int[Tensor, " m"]:
        """Moving rows in order."""
        self._sort()
        return self._moving

    def version(self) -> int:
        """A number that is higher once other rows are static."""
        self._sort()
        return self._sorts

    def _sort(self) -> None:
        # Offsets are replaced, never changed: only then does a GPU count again, and the host wait.
        if self._sorted_by is not self.stillness.offsets:
            self._sorted_by, still = self.stillness.offsets, self.mask()
            self._still, self._moving = still.nonzero()[:, 0], (~still).nonzero()[:, 0]
            self._sorts += 1

    def moving_rows(self, ones: Int[Tensor, " r"]) -> dict[str, Rows]:
        """The columns' values of new moving rows: one for each of ``ones``."""
        evidence, terms = self.stillness.values, self.terms.values
        first = terms.new_tensor([FIRST_TERM, 2.0 * FIRST_TERM]).repeat(len(ones), 1)
        return {"stillness": Rows(evidence[:0], torch.zeros_like(ones)), "terms": Rows(first)}

    # Evidence.

    def watch(self, splats: Splats, time: Float[Tensor, ""]) -> None:
        """Record the gradients of splats at ``time`` in the backward pass.

        Splats without a graph are ignored. They are all of the model's rows, in order.
        """
        if not splats.means.requires_grad or splats.rows is not None:
            return
        rows = self.rows()
        for values, directions in ((splats.means, POSITION), (splats.opacities, OPACITY)):
            self._note_once(values, directions, rows, time)

    def _note_once(
        self, drawn: Tensor, directions: slice, rows: Int[Tensor, " s"], time: Float[Tensor, ""]
    ) -> None:
        def note(gradient: Tensor) -> None:
            handle.remove()  # A parameter that is rendered without a change would keep its hook.
            self._add(
                gradient.detach().view(len(gradient), -1).index_select(0, rows), directions, time
            )

        handle = drawn.register_hook(note)

    def _add(
        self, gradient: Float[Tensor, "s d"], directions: slice, time: Float[Tensor, ""]
    ) -> None:
        values = self.stillness.values[..., directions]
        steps = [gradient * torch.cos(math.pi * k * time).to(gradient) for k in FREQUENCIES]
        # A step that is not finite is recorded too. Whatever its size, a single one brings no ratio
        # above 1, which is that of rows that need no time.
        noted = torch.stack(steps, dim=1).to(values).nan_to_num_(0.0, 0.0, 0.0)
        noted.clamp_(-LARGEST, LARGEST)
        values[:, 0] += noted
        values[:, 1] += noted.square()

    def signals(self) -> Float[Tensor, " s"]:
        """Root mean square of z over directions and frequencies: 1 for rows that need no time."""
        sums, squares = self.stillness.values.unbind(1)
        return _ratios(sums, squares).square().mean((1, 2)).sqrt()

    def wanted(self) -> Float[Tensor, " s"]:
        """Time at which the gradients demand the most opacity, from the correlated waves."""
        times = torch.linspace(0, 1, 17, device=self.stillness.values.device)
        waves = torch.stack([torch.cos(math.pi * k * times) for k in FREQUENCIES])
        asked = -self.stillness.values[:, 0, :, OPACITY].squeeze(2) @ waves.to(
            self.stillness.values
        )
        return times[asked.argmax(dim=1)]

    def forget_(self) -> None:
        """Decay earlier evidence: that of a row that was static for long is old."""
        fading = torch.tensor([REMEMBERED, REMEMBERED**2])
        self.stillness.values.mul_(fading.to(self.stillness.values).view(2, 1, 1))

    # Terms.

    def patient(self) -> Bool[Tensor, " n"]:
        """Rows that have moved for long enough to be judged; counts one more round for all."""
        waiting = self.terms.values[:, 0]
        waiting.sub_(1.0).clamp_(min=0.0)
        return waiting == 0

    def extend_(self, rows: Int[Tensor, " r"]) -> None:
        """Let rows that begin to move keep moving for some rounds, and longer the next time."""
        terms = self.terms.values[rows]
        self.terms.values[rows] = torch.stack([terms[:, 1], 2.0 * terms[:, 1]], dim=1)


def _ratios(sums: Tensor, squares: Tensor) -> Tensor:
    """Sums over the roots of sums of squares; 0 without observations."""
    return torch.where(squares > 0, sums / squares.clamp_min(1e-38).sqrt(), 0.0)
