"""PlayCanvas, an engine that is not ours, shows each level as our rasterizer does."""

import pytest
from support.asymmetric_scene import cameras, ours, psnr, scene
from support.chromium import needs_chromium
from support.playcanvas import playcanvas_viewer
from support.spark import image_in
from support.splat_transform import needs_splat_transform
from support.tree_levels import nodes

from gsfw.lod.streamed_sog import StreamedSogExporter

pytestmark = [pytest.mark.slow, pytest.mark.unchecked, needs_chromium, needs_splat_transform]

LEAST = 36.0
"""PSNR in dB; all reach 37.6, and none reaches 24 with another level."""


def test_playcanvas_shows_every_level_as_our_rasterizer_does(tmp_path):
    content = scene(1)
    options = {"num_levels": 3, "region": 32, "chunk": 64, "sharing": 1}
    StreamedSogExporter(**options).write(tmp_path / "scene", content)
    with playcanvas_viewer(tmp_path, tmp_path / "chromium") as page:
        for level in range(3):
            assert page.evaluate(f"load('/files/scene/lod-meta.json', {level})")
            for camera in cameras(content.splats):
                shown = image_in(page, camera)
                likeness = [psnr(ours(nodes(content, other), camera), shown) for other in range(3)]
                assert likeness[level] > LEAST
                assert likeness[level] == max(likeness)
                mirrored = psnr(ours(nodes(content, level), camera), shown[:, ::-1])
                assert mirrored < LEAST - 12, "another image would be told apart"
        assert page.errors(allowed=("GL Driver Message",)) == []
