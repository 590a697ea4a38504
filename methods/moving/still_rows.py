"""StillRows: which rows of a model do not change with time, and what says that they should.

A row that stands still and should not is pulled one way early in the sequence and another way
late: the gradients of its position and opacity correlate with time, whatever their size. For a
direction g of the gradient and phi_k(t) = cos(k pi t), k = 1, 2, the sum of g phi_k over the steps
has the variance sum (g phi_k)^2 if g has nothing to do with t, so that their quotient

    z = sum g phi_k / sqrt(sum (g phi_k)^2)

is a signal-to-noise ratio: it has mean 0 and deviation 1 for a row that needs no time, and it knows
neither the scene's units nor the loss's. A mean gradient, of a row that is merely on its way to
its place, adds nothing to it, as the phi_k have none over the sequence.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from gsfw.core.column import Column, Layout, Rows
from gsfw.core.splats import Splats

FREQUENCIES = (1, 2)
"""Half-waves over the sequence that gradients are compared with: early or late, middle or ends."""
POSITION, OPACITY = slice(0, 3), slice(3, 4)
DIRECTIONS = 4
"""Three of the position, and the opacity."""
REMEMBERED = 0.9
"""What is left of earlier evidence from one look at it to the next: it spans ten intervals."""
LARGEST = 1e15
"""Greater gradients count as this, whose squares can be summed in float32."""
FIRST_TERM = 4.0
"""Looks for which a row that has begun to move goes on: shorter and it cannot have got far."""


class StillRows(nn.Module):
    """Two columns without learning rates, so that density control takes them along.

    ``stillness``, ragged: rows that stand still have one value, the evidence gathered
    [2, frequencies, directions] (the sums, and those of the squares); all others have none.
    ``terms``: looks for which a row goes on moving whatever it does, and how many the next time,
    which are twice as many, so that no row goes back and forth for long.
    """

    def __init__(self, count: int, all_still: bool) -> None:
        """Of ``count`` rows, all of which stand still, or none."""
        super().__init__()
        still = count if all_still else 0
        evidence = torch.zeros(still, 2, len(FREQUENCIES), DIRECTIONS)
        offsets = torch.arange(count + 1) if all_still else torch.zeros(count + 1).long()
        self.stillness = Column(evidence, layout=Layout.RAGGED, offsets=offsets)
        self.terms = Column(torch.tensor([0.0, FIRST_TERM]).repeat(count, 1))
        self._sorted_by: Tensor | None = None
        self._still = self._moving = torch.zeros(0, dtype=torch.int64)

    def columns(self) -> dict[str, Column]:
        """Both, by name."""
        return {"stillness": self.stillness, "terms": self.terms}

    def mask(self) -> Bool[Tensor, " n"]:
        """Whether each row stands still."""
        assert self.stillness.offsets is not None
        return self.stillness.offsets.diff() > 0

    def rows(self) -> Int[Tensor, " s"]:
        """Those that stand still, in order: that of the evidence."""
        self._sort()
        return self._still

    def moving(self) -> Int[Tensor, " m"]:
        """All others, in order."""
        self._sort()
        return self._moving

    def _sort(self) -> None:
        # Offsets are replaced, never changed: only then does a GPU count anew, and is waited for.
        if self._sorted_by is not self.stillness.offsets:
            self._sorted_by, still = self.stillness.offsets, self.mask()
            self._still, self._moving = still.nonzero()[:, 0], (~still).nonzero()[:, 0]

    def moving_rows(self, ones: Int[Tensor, " r"]) -> dict[str, Rows]:
        """The columns' values of new rows that move: as many as there are ones."""
        evidence, terms = self.stillness.values, self.terms.values
        first = terms.new_tensor([FIRST_TERM, 2.0 * FIRST_TERM]).repeat(len(ones), 1)
        return {"stillness": Rows(evidence[:0], torch.zeros_like(ones)), "terms": Rows(first)}

    # Evidence.

    def watch(self, splats: Splats, time: Float[Tensor, ""]) -> None:
        """Take note of the gradients of splats that are drawn at ``time``, once they are there.

        Nothing is noted of splats without a graph. They are all of the model's rows, in order.
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
            handle.remove()  # A parameter that is drawn as it is would keep its hook.
            self._add(
                gradient.detach().view(len(gradient), -1).index_select(0, rows), directions, time
            )

        handle = drawn.register_hook(note)

    def _add(
        self, gradient: Float[Tensor, "s d"], directions: slice, time: Float[Tensor, ""]
    ) -> None:
        values = self.stillness.values[..., directions]
        steps = [gradient * torch.cos(math.pi * k * time).to(gradient) for k in FREQUENCIES]
        # A step that turns out not to be finite is noted too. Whatever size it has, a single one
        # brings no ratio above 1, which is that of rows that need no time.
        noted = torch.stack(steps, dim=1).to(values).nan_to_num_(0.0, 0.0, 0.0)
        noted.clamp_(-LARGEST, LARGEST)
        values[:, 0] += noted
        values[:, 1] += noted.square()

    def signals(self) -> Float[Tensor, " s"]:
        """Root mean square of z over directions and frequencies: 1 for rows that need no time."""
        sums, squares = self.stillness.values.unbind(1)
        return _ratios(sums, squares).square().mean((1, 2)).sqrt()

    def wanted(self) -> Float[Tensor, " s"]:
        """The time at which gradients ask for the most opacity, by the waves they were seen in."""
        times = torch.linspace(0, 1, 17, device=self.stillness.values.device)
        waves = torch.stack([torch.cos(math.pi * k * times) for k in FREQUENCIES])
        asked = -self.stillness.values[:, 0, :, OPACITY].squeeze(2) @ waves.to(
            self.stillness.values
        )
        return times[asked.argmax(dim=1)]

    def forget_(self) -> None:
        """Let earlier evidence weigh less: that of a row that was still for long is old."""
        fading = torch.tensor([REMEMBERED, REMEMBERED**2])
        self.stillness.values.mul_(fading.to(self.stillness.values).view(2, 1, 1))

    # Terms.

    def patient(self) -> Bool[Tensor, " n"]:
        """Rows that have moved for long enough to be judged; one more look has passed for all."""
        waiting = self.terms.values[:, 0]
        waiting.sub_(1.0).clamp_(min=0.0)
        return waiting == 0

    def extend_(self, rows: Int[Tensor, " r"]) -> None:
        """Let rows that begin to move go on for a while, and longer the next time."""
        terms = self.terms.values[rows]
        self.terms.values[rows] = torch.stack([terms[:, 1], 2.0 * terms[:, 1]], dim=1)


def _ratios(sums: Tensor, squares: Tensor) -> Tensor:
    """Sums over the roots of sums of squares; 0 where nothing was seen."""
    return torch.where(squares > 0, sums / squares.clamp_min(1e-38).sqrt(), 0.0)
