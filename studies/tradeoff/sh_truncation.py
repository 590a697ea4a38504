"""ShTruncation: colours without their upper SH bands."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from gsfw.core.maths.spherical_harmonics import num_coefficients
from gsfw.core.splats import Sh, Splats
from gsfw.studies.tradeoff.storage import Cut, Storage


@dataclass(frozen=True)
class ShTruncation(Cut):
    """Leaves out every band above a degree; what is left stays as it is."""

    degree: int

    def __call__(self, splats: Splats) -> Splats:
        """The splats with colours of at most this degree; channels stay as they are."""
        colors = splats.colors
        if not isinstance(colors, Sh) or colors.degree <= self.degree:
            return splats
        count = num_coefficients(self.degree)
        if colors.rest is None:
            left = colors.coefficients[:, :count].contiguous()
            return replace(splats, colors=Sh(left, self.degree))
        if count == 1:
            return replace(splats, colors=Sh(colors.coefficients, 0))
        if colors.offsets is not None:
            return replace(splats, colors=_shorter(colors, count - 1, self.degree))
        rest = colors.rest[:, : count - 1].contiguous()
        return replace(splats, colors=Sh(colors.coefficients, self.degree, rest))

    def left_of(self, storage: Storage) -> Storage:
        """All but the coefficients of the upper bands."""
        return storage.up_to_degree(self.degree)


def _shorter(colors: Sh, count: int, degree: int) -> Sh:
    """Ragged colours with at most ``count`` coefficients each beside the constant one."""
    assert colors.rest is not None
    assert colors.offsets is not None
    lengths = colors.offsets.diff()
    place = torch.arange(len(colors.rest), device=lengths.device)
    place = place - colors.offsets[:-1].repeat_interleave(lengths)
    offsets = torch.cat([lengths.new_zeros(1), lengths.clamp_max(count).cumsum(0)])
    return Sh(colors.coefficients, degree, colors.rest[place < count], offsets)


def sh_degree(splats: Splats) -> int:
    """The degree that is drawn; 0 for colours that are the same from everywhere."""
    return splats.colors.degree if isinstance(splats.colors, Sh) else 0
