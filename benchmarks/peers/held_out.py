"""HeldOutViews: the score of any trainer's PLY, on views that no trainer saw."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch

from gsfw.core.datamanager import DataManager, Split
from gsfw.core.maths.frame import transform_splats
from gsfw.core.metrics import Psnr, Ssim
from gsfw.core.render_settings import RenderSettings
from gsfw.plugins.compose import open_data
from gsfw.plugins.initial_splats import find_importer
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, resolve
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer
from peers.job import BLACK, Color

CPU = torch.device("cpu")


@dataclass(frozen=True)
class Score:
    """Means over the held-out views."""

    psnr: float
    """In dB, of values clamped to [0, 1]."""
    ssim: float
    gaussians: int


class HeldOutViews:
    """The held-out views of a data set, as gsfw reads and splits it."""

    def __init__(self, data: DataManager) -> None:
        """Take the views of an open data set.

        Raises:
            SystemExit: none is held out.
        """
        if len(data.views(Split.EVAL)) == 0:
            raise SystemExit(f"{data.scene.name} holds out no views to score: it needs at least 2.")
        self.data = data

    @staticmethod
    def open(path: Path, downscale: float) -> HeldOutViews:
        """Open a data set of any format that gsfw reads.

        Args:
            path: the data set.
            downscale: factor by which all images are shrunk.

        Raises:
            DataError: it cannot be read.
        """
        values = {"method": "3dgs", "data": str(path), "downscale": downscale}
        return HeldOutViews(open_data(resolve(installed(), [Layer("bench of peers", values)])))

    @torch.no_grad()
    def score(self, file: Path, background: Color = BLACK) -> Score:
        """Render a splat file from the held-out views and compare.

        Args:
            file: in the world of the data.
            background: over which its trainer rendered.

        Raises:
            DataError: it is no splat file; names the cause.
        """
        content = find_importer(file, installed()).read(file)
        world = self.data.scene.world_from_scene
        splats = transform_splats(content.splats, world.inverse()).map(torch.Tensor.float)
        settings = RenderSettings(torch.tensor(background), antialias=content.antialiased)
        rasterizer, metrics = CpuRasterizer(), (Psnr(), Ssim())
        figures = []
        for index in range(len(self.data.views(Split.EVAL))):
            (batch,) = self.data.load(Split.EVAL, [index], CPU)
            image = rasterizer.render(splats, batch.cameras, settings).color[0]
            figures.append([metric(image, batch.images[0], None) for metric in metrics])
        psnr, ssim = torch.tensor(figures, dtype=torch.float64).mean(0).tolist()
        return Score(psnr, ssim, len(splats))
