"""Agreement: distance of a rasterizer's images and gradients to the float64 reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.bench.workload import SEED, scattered
from gsfw.studies.entrants import Entrant

FLIP = 1e-5
"""A pixel with a larger error has another list of splats, by a rounding at a cut-off."""

RANDOM_SPLATS, RANDOM_SIZE = 2000, (160, 104)
"""Splats and size of each random scene: about 50 large splats per pixel, as in larger scenes."""

REFERENCE_CHUNK_MB, REFERENCE_PAIRS_MB = 64.0, 16384.0

Errors = Mapping[str, float]


def agreement(entrant: Entrant, splats: Splats, cameras: Cameras) -> Errors:
    """Errors of one scene: |found - expected| / |expected| in L2, unless said otherwise.

    ``image``: relative error of the image; ``largest``: the largest absolute error of a color;
    ``flips``: number of pixels with an error above 1e-5; ``gradient of NAME``: of every field and
    the pose, from one random gradient of the image.
    """
    reference = ReferenceRasterizer(REFERENCE_CHUNK_MB, REFERENCE_PAIRS_MB)
    expected = _rendered(
        reference,
        splats.map(lambda tensor: tensor.double()),
        cameras.to(dtype=torch.float64),
        entrant.settings,
    )
    found = _rendered(entrant.rasterizer, splats, cameras, entrant.settings)
    difference = (found["image"].double() - expected["image"]).abs()
    errors = {name: _distance(found[name], tensor) for name, tensor in expected.items()}
    errors["largest"] = float(difference.max())
    errors["flips"] = float((difference.amax(-1) > FLIP).sum())
    return errors


def agreement_at_random(entrant: Entrant, scenes: int, device: torch.device) -> Errors:
    """The largest of each error over random scenes, and the sum of all flips."""
    errors: dict[str, list[float]] = {}
    for seed in range(SEED, SEED + scenes):
        scene = scattered(RANDOM_SPLATS, *RANDOM_SIZE, device, seed)
        for name, error in agreement(entrant, *scene).items():
            errors.setdefault(name, []).append(error)
    # The largest of a tensor is NaN if one of its numbers is.
    worst = {name: float(torch.tensor(found).amax()) for name, found in errors.items()}
    return worst | {"flips": sum(errors.get("flips", ()))}


def _rendered(
    rasterizer: Rasterizer, splats: Splats, cameras: Cameras, settings: RenderSettings
) -> dict[str, Tensor]:
    """The image, and the gradients from one random gradient of it."""
    splats = splats.map(lambda tensor: tensor.detach().clone().requires_grad_())
    pose = cameras.world_to_camera.clone().requires_grad_()
    output = rasterizer.render(splats, replace(cameras, world_to_camera=pose), settings)
    generator = torch.Generator().manual_seed(SEED)
    weights = torch.randn(output.color.shape, generator=generator, dtype=torch.float64)
    output.color.backward(weights.to(output.color))
    leaves = splats.tensors() | {"pose": pose}
    gradients = {
        f"gradient of {name}": torch.zeros_like(leaf) if leaf.grad is None else leaf.grad
        for name, leaf in leaves.items()
    }
    return {"image": output.color.detach(), **gradients}


def _distance(found: Tensor, expected: Tensor) -> float:
    """|found - expected| / |expected|; the difference itself where ``expected`` is 0."""
    size = float(expected.norm())
    return float((found.double() - expected).norm()) / (size if size > 0.0 else 1.0)
