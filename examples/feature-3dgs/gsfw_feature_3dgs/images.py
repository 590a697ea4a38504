"""Images of features: principal components as colours, and heat maps."""

from __future__ import annotations

import torch

SPREAD = 2.0
"""Standard deviations that lie between gray and full colour."""
STOPS = ((0.1, 0.1, 0.3), (0.15, 0.4, 0.6), (0.6, 0.75, 0.3), (1.0, 0.75, 0.15), (0.9, 0.1, 0.1))
"""Colours of heat from 0 to 1."""


@torch.no_grad()
def principal_colors(model, rendered):
    """The first image's features as RGB [h, w, 3]: their components along the axes of the model's.

    The axes are those of all Gaussians together, so that views of one model agree in colours.
    """
    features = model.decoded(model.extra["features"].values).double()
    mean = features.mean(0)
    values, axes = torch.linalg.eigh((features - mean).T @ (features - mean) / len(features))
    count = min(3, len(values))
    # The sign of an axis is arbitrary: its largest entry is positive.
    axes = axes[:, -count:].flip(1)
    axes = axes * axes.gather(0, axes.abs().argmax(0, keepdim=True)).sign()
    scale = values[-count:].flip(0).clamp_min(1e-12).sqrt()
    alpha = rendered.alpha[0]
    found = model.decoded(rendered.extra[0]).double() - mean * alpha
    colors = 0.5 + 0.5 * (found @ axes) / (SPREAD * scale)
    colors = torch.nn.functional.pad(colors, (0, 3 - count), value=0.5)
    return (colors.clamp(0, 1) * alpha).float()


def heat(values):
    """Colours [h, w, 3] of values [h, w] in [0, 1]."""
    stops = values.new_tensor(STOPS)
    place = values.clamp(0, 1) * (len(STOPS) - 1)
    first = place.floor().clamp(max=len(STOPS) - 2).long()
    share = (place - first)[..., None]
    return (1 - share) * stops[first] + share * stops[first + 1]
