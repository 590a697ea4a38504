"""The contributing pairs of an image, counted pixel by pixel."""

import math

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.cameras import Cameras
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.reference.project import project
from gsfw.studies.bench.pairs import contributing_pairs
from gsfw.studies.bench.workload import read_workload


def counted_one_by_one(splats: Splats, camera: Cameras) -> int:
    """The definition, for every pixel and splat."""
    ellipses = project(splats, camera, RenderSettings())
    order = ellipses.depths.argsort(stable=True).tolist()
    count = 0
    for y in range(camera.height):
        for x in range(camera.width):
            transmittance = 1.0
            for row in order:
                dx, dy = (torch.tensor([x + 0.5, y + 0.5]) - ellipses.means[row]).tolist()
                xx, xy, yy = ellipses.covariances[row].tolist()
                power = (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
                alpha = min(0.99, float(ellipses.opacities[row]) * math.exp(-0.5 * power))
                if alpha < 1 / 255:
                    continue
                transmittance *= 1 - alpha
                if transmittance <= 1e-4:
                    break
                count += 1
    return count


def test_the_count_is_that_of_the_definition():
    splats, camera = random_splats(30), front_camera(13, 9)  # Not a multiple of any tile.
    expected = counted_one_by_one(splats, camera)
    assert expected > 100
    assert contributing_pairs(splats, camera, RenderSettings()) == expected


def test_cameras_add_up_and_nothing_counts_nothing():
    splats, camera = random_splats(20), front_camera(10, 10)
    one = contributing_pairs(splats, camera, RenderSettings())
    both = contributing_pairs(splats, Cameras.cat([camera, camera]), RenderSettings())
    assert both == 2 * one
    behind = front_camera(10, 10, distance=-9.0)
    assert contributing_pairs(splats, behind, RenderSettings()) == 0


@pytest.mark.slow
def test_the_garden_has_thirteen_million(shared_data):
    workload = read_workload(shared_data / "reference" / "garden_workload.npz")
    count = contributing_pairs(workload.splats, workload.cameras, RenderSettings())
    assert count == pytest.approx(13.0e6, rel=0.005)
