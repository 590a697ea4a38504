"""Measurement: errors of a variant against exact images, and its times and memory in turns."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.loop.device import wait_for
from gsfw.core.loop.memory import added_memory_mb
from gsfw.core.render_settings import Validation
from gsfw.core.splats import Splats
from gsfw.plugins.registry import Registry
from gsfw.studies.entrants import REFERENCE, entrant_of
from gsfw.studies.tradeoff.subject import Subject, enlarged


@dataclass(frozen=True)
class ImageError:
    """Distance of images from exact ones."""

    relative: float
    """Norm of the difference over the norm of the exact images."""
    largest: float
    """Largest difference of a colour."""


class Exact:
    """Small images of the unchanged model in float64, from which errors are measured."""

    def __init__(self, subject: Subject, cameras: Sequence[Cameras], registry: Registry) -> None:
        """Render them with the reference rasterizer and the settings of the run."""
        self.cameras = cameras
        device = cameras[0].world_to_camera.device
        rasterizer = entrant_of(REFERENCE, registry, device).rasterizer
        self._exact = _images(replace(subject, rasterizer=rasterizer, dtype=torch.float64), cameras)

    def error(self, subject: Subject) -> ImageError:
        """Distance of a variant's images from the exact ones.

        Raises:
            ValueError: its splats have values that cannot be rendered; says which.
        """
        settings = replace(subject.settings, validation=Validation.FULL)
        subject = replace(subject, settings=settings)
        difference = _images(subject, self.cameras) - self._exact
        relative = float(difference.norm() / self._exact.norm().clamp_min(1e-30))
        return ImageError(relative, float(difference.abs().max()))


def _images(subject: Subject, cameras: Sequence[Cameras]) -> Float[Tensor, " m"]:
    """All pixels of all images in a row, before any colour network; float64."""
    rendered = []
    for camera, splats in zip(cameras, subject.splats_by_camera(cameras), strict=True):
        image = subject.render(splats, camera).color[0].double()
        rendered.append(enlarged(image, camera).flatten())
    return torch.cat(rendered)


@dataclass(frozen=True)
class Turn:
    """A variant with its splats ready for rendering, as in a viewer."""

    subject: Subject
    splats: tuple[Splats, ...]
    """Splats for each camera."""
    cameras: Sequence[Cameras]

    @staticmethod
    def of(subject: Subject, cameras: Sequence[Cameras]) -> Turn:
        """Make the splats; their time is not measured, since no variant changes it."""
        return Turn(subject, tuple(subject.splats_by_camera(cameras)), cameras)

    def take(self, device: torch.device) -> float:
        """Render every view once; milliseconds of wall time for a view."""
        # After another's turn threads sleep and caches are cold, as they never are in a viewer:
        # the first image does not count.
        self._render_first()
        wait_for(device)
        started = time.perf_counter()
        for splats, camera in zip(self.splats, self.cameras, strict=True):
            self.subject.image(splats, camera)
        wait_for(device)
        return 1e3 * (time.perf_counter() - started) / len(self.cameras)

    def memory(self, device: torch.device) -> float | None:
        """Render the first view; megabytes that this takes, ``None`` if unknown."""
        # The first image of a variant allocates memory that stays for all that follow.
        self._render_first()
        return added_memory_mb(self._render_first, device)

    def _render_first(self) -> None:
        self.subject.image(self.splats[0], self.cameras[0])
