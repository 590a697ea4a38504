"""ViewErrors: the error that rows have in several views, as far as the views agree.

The error of a pixel is summed over the contributions of each splat (Rota Bulo et al. 2024, equation
7). A row counts with the value that several views reach, so that the error of a single view (a
passer-by, a reflection, blur) attracts no rows: the idea of Ren et al. 2025 (FastGS), who average
the number of bad pixels over sampled views.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.context import StepContext


class ViewErrors:
    """Gathers errors over some steps, between which the number of rows does not change.

    Errors are fractions of an image, so that the image size has no effect. A view counts once.
    """

    def __init__(self, num_rows: int, agreeing: int, device: torch.device) -> None:
        """Start without views.

        Args:
            num_rows: rows of the model.
            agreeing: views that have to agree on the error of a row, at least 1.
            device: of the rows.
        """
        self._largest = torch.zeros(agreeing, num_rows, device=device)
        self._seen = torch.zeros(num_rows, dtype=torch.int32, device=device)
        self._views: set[int] = set()

    @torch.no_grad()
    def add(self, context: StepContext) -> None:
        """Add those views of a batch that were not added before; no synchronisation.

        To be called in ``before_backward``. Invalid pixels have no error, and images that are not
        finite none at all.
        """
        views = context.batch.views
        if self._views.issuperset(views):
            return
        found = context.contributions(_errors(context)).to(self._largest)
        visible = context.rendered.statistics.visible.to(self._seen)
        for place, view in enumerate(views):
            if view not in self._views:
                self._add_view(found[place], visible[place], context.splats.rows)
                self._views.add(view)

    def _add_view(
        self,
        found: Float[Tensor, " m"],
        visible: Int[Tensor, " m"],
        rows: Int[Tensor, " m"] | None,
    ) -> None:
        if rows is None:
            self._seen += visible
        else:
            self._seen.index_add_(0, rows, visible)
            found = torch.zeros_like(self._largest[0]).index_copy_(0, rows, found)
        for place, larger in enumerate(self._largest):
            self._largest[place], found = larger.maximum(found), larger.minimum(found)

    @property
    def agreed(self) -> Float[Tensor, " n"]:
        """The error that as many views reach as have to agree, or all that see the row if fewer do.

        So a row that is there for a single image of a moving scene counts too. A view sees all rows
        that are visible, hidden or not. 0 where no view has an error.
        """
        place = self._seen.clamp(1, len(self._largest)).long() - 1
        return self._largest.gather(0, place[None])[0]

    def state_dict(self) -> dict[str, Any]:
        """The largest errors, and the views."""
        return {"largest": self._largest, "seen": self._seen, "views": sorted(self._views)}

    @staticmethod
    def restored(state: Mapping[str, Any]) -> ViewErrors:
        """The errors that ``state_dict`` returned."""
        largest = state["largest"]
        found = ViewErrors(0, len(largest), largest.device)
        found._largest, found._seen = largest.clone(), state["seen"].clone()
        found._views = set(state["views"])
        return found


def _errors(context: StepContext) -> Float[Tensor, "c h w 1"]:
    """Mean absolute difference of the channels of each pixel, over the number of pixels."""
    errors = (context.rendered.color - context.target).abs().mean(-1, keepdim=True)
    if context.batch.valid is not None:
        errors = torch.where(context.batch.valid, errors, 0.0)
    whole = errors.isfinite().all(-1).all(-1).all(-1)[:, None, None, None]
    _, height, width, _ = errors.shape
    return torch.where(whole, errors, 0.0) / (height * width)
