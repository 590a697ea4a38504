"""Rasterizer: the contract of every rendering backend."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.bands import Bands
from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Capabilities
from gsfw.core.input_checks import check_form, check_values
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import Depth, RenderSettings, Statistic, Validation
from gsfw.core.returns import check_output
from gsfw.core.splats import Splats


@dataclass(frozen=True)
class StageTime:
    """Duration of one stage of rendering: summed over all threads, and by the wall clock."""

    cpu_ms: float
    """Sum over all threads, in milliseconds."""
    wall_ms: float
    """Duration by the wall clock, in milliseconds."""


class Rasterizer(ABC):
    """Renders splats. A backend implements ``capabilities`` and ``_render``.

    Callers use ``render`` and ``contributions``, which check their inputs first. A run asks only
    for features that ``capabilities`` names: what a backend does not claim, it need not handle.
    """

    @classmethod
    @abstractmethod
    def capabilities(cls) -> Capabilities:
        """Abilities of this backend on this machine; builds nothing."""

    @final
    def render(
        self, splats: Splats, cameras: Cameras, settings: RenderSettings | None = None
    ) -> RenderOutput:
        """Render ``splats`` from each camera.

        Raises:
            ValueError: an input has a wrong shape, device or dtype, or (with full validation) holds
                values that cannot be rendered; the message names the field and the first row.
            ConfigError: the backend returned no images, or images of a wrong shape.
        """
        settings = settings or RenderSettings()
        check_form(splats, cameras, settings)
        if settings.validation is Validation.FULL:
            check_values(splats, cameras, settings)
        output = self._render(splats, cameras, settings)
        images = (len(cameras), cameras.height, cameras.width)
        extras = None if splats.extra is None else splats.extra.shape[1]
        check_output(type(self).__name__, output, images, splats.channels, extras)
        return output

    @final
    @torch.no_grad()
    def contributions(
        self,
        splats: Splats,
        cameras: Cameras,
        weights: Float[Tensor, "c h w 1"] | None = None,
        settings: RenderSettings | None = None,
    ) -> Float[Tensor, "c n"]:
        """Sum ``weights`` times alpha times transmittance over the pixels of each splat.

        It takes one forward pass without colours, so ``weights`` may depend on a rendered image,
        such as an error image (Rota Bulo et al. 2024, equation 7). Weights that are known before
        rendering cost no second pass in ``RenderSettings.contribution_weights``.

        Args:
            splats: the splats, whose colours and extra channels are ignored.
            cameras: one per image of ``weights``.
            weights: any finite numbers, which may be negative; ``None`` for ones.
            settings: the settings of the render; only its background, depth and statistics
                are ignored.

        Raises:
            ValueError: an input has a wrong shape, device or dtype, or (with full validation) holds
                values that are not finite or out of range.
        """
        # Three channels are no slower than one: every backend compiles them for images.
        splats = replace(splats, colors=splats.means.new_zeros(len(splats), 3), extra=None)
        settings = replace(
            settings or RenderSettings(),
            background=None,
            depth=Depth.NONE,
            statistics=frozenset({Statistic.CONTRIBUTION}),
            contribution_weights=weights,
        )
        sums = self.render(splats, cameras, settings).statistics.contribution
        assert sums is not None, "it was asked for"
        return sums

    def bands(
        self, splats: Splats, cameras: Cameras, settings: RenderSettings, pixels: Sequence[range]
    ) -> Bands | None:
        """Images of which several processes render bands; ``None`` if it has no kernels for that.

        Args:
            splats: some splats of the images, which have the channels of all.
            cameras: one per image.
            settings: the settings of the render.
            pixels: rows of pixels of each band of an image, from above; all but the last have the
                same height, in whole tiles of 16.
        """
        return None

    @property
    def can_be_captured(self) -> bool:
        """True if renders and their backward passes can be captured in CUDA graphs.

        The first render of a size and kind never is.
        """
        return False

    def fits(self) -> Bool[Tensor, ""] | None:
        """True on the device if all captured images since the last call had enough memory.

        ``None`` if none was captured. Others are wrong, and further graphs need ``make_room``.
        """
        return None

    def make_room(self) -> None:  # noqa: B027
        """Give further captured images the memory that earlier ones lacked."""

    def stage_times(self) -> Mapping[str, StageTime]:
        """Stage durations of the latest ``render`` and its backward pass; empty if not measured."""
        return {}

    @abstractmethod
    def _render(self, splats: Splats, cameras: Cameras, settings: RenderSettings) -> RenderOutput:
        """Render inputs whose form, and with full validation whose values, are checked.

        Images have one row per camera. The cut-offs are those of ``settings.profile``, splats are
        blended in order of view depth, and the images are composited over ``settings.background``.
        ``RenderStatistics.zeros`` makes the statistics: ``visible`` and ``radii`` in any case, the
        others as ``settings.statistics`` asks.

        Returns:
            Images that are attached to the graph of the splats (and of the poses). Gradient
            statistics may stay zero until the backward pass fills them in place.
        """
