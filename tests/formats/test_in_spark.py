"""Spark, a viewer that is not ours, shows the files of gsfw as our own rasterizer does."""

import pytest
from support.asymmetric_scene import cameras, ours, psnr, scene
from support.chromium import needs_chromium
from support.spark import spark_viewer
from support.splat_transform import needs_splat_transform

from gsfw.plugins.exporters import make_exporter
from gsfw.plugins.registry import installed

pytestmark = [pytest.mark.slow, pytest.mark.unchecked, needs_chromium, needs_splat_transform]

FORMATS = ("ply", "compressed-ply", "splat", "ksplat", "spz", "sog")
"""What Spark reads."""
DEGREE = {"splat": 0}
"""Degree of SH of formats that hold none; 1 for all others."""
LEAST = 38.0
"""PSNR in dB; all reach 42. Spark rounds what it shows, and most formats round before."""


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
        assert psnr(expected, shown) > LEAST
        assert psnr(expected, shown[:, ::-1]) < LEAST - 15, "another image would be told apart"
    assert viewer.page.errors(allowed=("GL Driver Message",)) == []
