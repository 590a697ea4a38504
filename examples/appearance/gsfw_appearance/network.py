"""Appearance: an embedding of each training image, and a network from it to factors of colours."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn.functional import interpolate, relu

COARSE = 32
"""The network sees the render at this fraction of its sides (the paper's)."""
LEAST_CELLS = 4
"""Cells of the shorter side at least, for small images."""


class Appearance(nn.Module):
    """Factors of colours for each pixel, from a coarse render and the embedding of its image."""

    def __init__(self, images, width, channels, generator):
        super().__init__()
        self.embeddings = nn.Parameter(0.1 * torch.randn(images, width, generator=generator))
        self.coarse = nn.Conv2d(3 + width, channels, 3, padding=1)
        self.middle = nn.Conv2d(channels, channels, 3, padding=1)
        self.fine = nn.Conv2d(channels, 3, 1)
        for layer in (self.coarse, self.middle):
            deviation = (2 / layer.weight[0].numel()) ** 0.5
            layer.weight.data = deviation * torch.randn(layer.weight.shape, generator=generator)
            nn.init.zeros_(layer.bias)
        nn.init.zeros_(self.fine.weight)  # All factors are 1 at the start.
        nn.init.zeros_(self.fine.bias)

    def log_factors(self, colors, views):
        """Logarithms of the factors [c, h, w, 3] of renders [c, h, w, 3] of training images."""
        height, width = colors.shape[1:3]
        least = min(height, width, LEAST_CELLS)
        size = tuple(max(least, side // COARSE) for side in (height, width))
        small = interpolate(colors.detach().movedim(-1, 1), size, mode="area")
        own = self.embeddings[list(views)][:, :, None, None].expand(-1, -1, *size)
        hidden = relu(self.coarse(torch.cat([small, own], dim=1)))
        hidden = relu(self.middle(interpolate(hidden, scale_factor=2, mode="bilinear")))
        found = interpolate(self.fine(hidden), (height, width), mode="bilinear")
        return found.movedim(1, -1)
