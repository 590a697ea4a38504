"""The CUDA rasterizer: kernels that are compiled at first use."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Bool
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.capabilities import Capabilities, Determinism, Feature
from gsfw.core.rasterizer import Rasterizer, StageTime
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.kernels.cuda.availability import unavailable
from gsfw.kernels.cuda.instances import WIDTHS, Instances
from gsfw.kernels.cuda.launcher import Launcher
from gsfw.kernels.render_arguments import KernelInputs, KernelOutputs, KernelSettings
from gsfw.rasterizers.autograd import render
from gsfw.rasterizers.cuda.pair_rooms import PairRooms
from gsfw.rasterizers.cuda.stages import (
    SUM_CHANNELS,
    TILE_PIXELS,
    CudaForwardPass,
    Launching,
    StageClock,
    instances_of,
    kernels_of,
)
from gsfw.rasterizers.kernel_backend import ForwardPass, KernelBackend, StageLog

MAX_CHANNELS = WIDTHS[-1]
"""Most channels in one pass, those of extra and depth included."""

SORTED_BYTES = 24
"""Memory per tile intersection while it is sorted: three tiles and three payloads."""


class CudaRasterizer(Rasterizer):
    """Renders in float32 and float64 on the device of its launcher.

    Images have the same bits each time. Gradients have them when ``deterministic``, for which every
    tile intersection gets memory of its own; else they are summed in any order.
    """

    def __init__(
        self,
        launcher: Launcher,
        pairs_mb: float = 16384.0,
        deterministic: bool = False,
        time_stages: bool = False,
    ) -> None:
        self.pairs_mb = pairs_mb
        self._backend = CudaBackend(launcher, deterministic, time_stages)
        self._log = StageLog()

    @classmethod
    def capabilities(cls) -> Capabilities:
        """Everything; the config adds the settings' determinism."""
        return Capabilities(
            devices=frozenset({"cuda"}),
            camera_models=frozenset(CameraModel),
            features=frozenset(Feature),
            max_channels=MAX_CHANNELS,
            determinism=Determinism.NONE,
            preference=20,
            unavailable=unavailable(),
        )

    @property
    def can_be_captured(self) -> bool:
        """True unless the host reads a number: pairs of their own, or times."""
        return not (self._backend.deterministic or self._backend.measuring)

    def fits(self) -> Bool[Tensor, ""] | None:
        """True on the device if all images since the last call had room for their pairs."""
        return self._backend.rooms.fits()

    def make_room(self) -> None:
        """Give the images of the next graph as many pairs as those of earlier ones have had."""
        self._backend.rooms.make_room()

    def stage_times(self) -> Mapping[str, StageTime]:
        """Project, sort, bin, blend, blend_backward, project_backward; empty unless measured."""
        return dict(self._log)

    def _render(self, splats: Splats, cameras: Cameras, settings: RenderSettings) -> RenderOutput:
        return render(self._backend, self._log, self.pairs_mb, splats, cameras, settings)


class CudaBackend(KernelBackend):
    """The CUDA kernels, run by a launcher."""

    name = "cuda"
    max_pairs = 2**31 - 1

    def __init__(self, launcher: Launcher, deterministic: bool, measuring: bool) -> None:
        self._launcher = launcher
        self.deterministic, self.measuring = deterministic, measuring
        self._prepared: set[tuple[Instances, bool]] = set()
        self.rooms = PairRooms()

    def pair_bytes(self, channels: int, element_size: int) -> int:
        """Memory per tile intersection: sorting, checkpoints, and sums if it has its own."""
        dtype = torch.float64 if element_size == torch.float64.itemsize else torch.float32
        blended = Instances(dtype, False, -1, min(channels, MAX_CHANNELS), torch.int16)
        numbers = TILE_PIXELS // blended.chunk * (1 + blended.width)
        slot = 4 + (SUM_CHANNELS + channels) * element_size if self.deterministic else 0
        return SORTED_BYTES + numbers * element_size + slot

    def render(
        self, inputs: KernelInputs, settings: KernelSettings, outputs: KernelOutputs
    ) -> ForwardPass:
        """Render one image.

        Raises:
            ValueError: it has too many channels for one pass, or is on another device.
        """
        channels, device = len(inputs.background), inputs.background.device
        if channels > MAX_CHANNELS:
            raise ValueError(
                f"splats: expected at most {MAX_CHANNELS} channels with those of extra and depth, "
                f"found {channels}; render them in several passes"
            )
        if not self._launcher.reaches(device):
            raise ValueError(
                "splats.means: expected a tensor on the GPU that the rasterizer was built for, "
                f"found one on {device}"
            )
        chosen = instances_of(inputs, settings)
        kind = (chosen, settings.differentiated)
        if kind not in self._prepared:
            self._launcher.prepare(kernels_of(*kind))
            self._prepared.add(kind)
        clock = StageClock(self.measuring, device)
        launching = Launching(self._launcher, clock, chosen, self.deterministic, self.rooms)
        return CudaForwardPass(launching, inputs, settings, outputs)
