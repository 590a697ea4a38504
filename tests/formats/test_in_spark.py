"""Spark, a viewer that is not ours, shows the files of gsfw as our own rasterizer does."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from support.chromium import needs_chromium
from support.spark import spark_viewer
from support.splat_transform import needs_splat_transform

from gsfw.core.cameras import Cameras
from gsfw.core.exchange import SplatFile
from gsfw.core.maths.camera_path import look_at
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.plugins.exporters import make_exporter
from gsfw.plugins.registry import installed
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.stress.case import random_splats

pytestmark = [pytest.mark.slow, pytest.mark.unchecked, needs_chromium, needs_splat_transform]

FORMATS = ("ply", "compressed-ply", "splat", "ksplat", "spz", "sog")
"""What Spark reads."""
DEGREE = {"splat": 0}
"""Degree of SH of formats that hold none; 1 for all others."""
WIDTH, HEIGHT = 160, 120
LEAST = 38.0
"""PSNR in dB; all reach 42. Spark rounds what it shows, and most formats round before."""


def scene(degree: int) -> SplatFile:
    """Splats of many sizes and directions, far from the origin, with another shape from each side.

    Quaternions, colours and places have no symmetry: every wrong axis changes the image.
    """
    splats = random_splats(150, degree, dtype=torch.float64)
    assert splats.scales is not None
    generator = torch.Generator().manual_seed(2)
    stretch = torch.rand(150, 3, generator=generator, dtype=torch.float64) + 0.2
    middle = torch.tensor([0.8, -0.4, 0.6], dtype=torch.float64)
    moved = replace(
        splats,
        means=splats.means - splats.means.mean(0) + middle,
        scales=splats.scales * stretch,
        opacities=splats.opacities * 0.8 + 0.1,
    )
    return SplatFile(moved)


def cameras(splats: Splats) -> list[Cameras]:
    """Two cameras, at an angle."""
    middle = splats.means.mean(0)
    size = float((splats.means - middle).norm(dim=1).quantile(0.8))
    places = middle + size * 2.6 * torch.tensor([[0.3, -0.4, -0.9], [0.9, 0.2, 0.3]]).double()
    up = torch.tensor([0.1, -1.0, 0.0], dtype=torch.float64)
    focal = WIDTH / 2 / math.tan(math.radians(30))
    lens = torch.tensor([[focal, 0, WIDTH / 2], [0, focal, HEIGHT / 2], [0, 0, 1]]).double()
    poses = look_at(places, middle, up)
    return [Cameras(pose[None], lens[None], WIDTH, HEIGHT) for pose in poses]


def ours(splats: Splats, camera: Cameras) -> np.ndarray:
    exact = splats.map(torch.Tensor.double)
    output = ReferenceRasterizer().render(exact, camera, RenderSettings())
    return output.color[0].clamp(0, 1).numpy()


@pytest.fixture(scope="module")
def viewer(tmp_path_factory):
    folder = tmp_path_factory.mktemp("spark")
    with spark_viewer(folder, folder / "chromium") as opened:
        yield opened


@pytest.mark.parametrize("form", FORMATS)
def test_spark_shows_what_our_rasterizer_does(viewer, form):
    if form not in installed().slot("exporter"):
        pytest.skip(f"format {form} is not installed")
    content = scene(DEGREE.get(form, 1))
    exporter = make_exporter(form, installed())
    path = viewer.folder / f"scene{exporter.suffix}"
    exporter.write(path, content)
    assert viewer.load(path, upright=form == "spz") == len(content.splats)
    for camera in cameras(content.splats):
        expected, shown = ours(content.splats, camera), viewer.look(camera)
        assert float(expected.std()) > 0.1, "the image shows something"
        psnr = -10 * math.log10(float(((expected - shown) ** 2).mean()))
        mirrored = -10 * math.log10(float(((expected - shown[:, ::-1]) ** 2).mean()))
        assert psnr > LEAST
        assert mirrored < LEAST - 15, "another image would be told apart"
    assert viewer.page.errors(allowed=("GL Driver Message",)) == []
