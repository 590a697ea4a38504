"""Projection on the emulation against the reference."""

import math
from dataclasses import replace

import pytest
import torch
from emulation.launcher import EmulatedLauncher
from support.projection_jobs import SCENES, Scene, projected, reference_of, scene_of
from support.scenes import front_camera, random_splats
from torch import Tensor

from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh
from gsfw.rasterizers.cuda.stages import SPLAT_CHANNELS


def expected_splats(scene: Scene, stride: int) -> Tensor:
    """[m, stride], by the formulas of stages.h."""
    expected = reference_of(*scene)
    ellipses, profile = expected.ellipses, scene[2].profile
    xx, xy, yy = ellipses.covariances.unbind(1)
    determinants, opacities = ellipses.determinants, ellipses.opacities
    level_min = math.log2(profile.alpha_min) if profile.alpha_min > 0 else -1e30
    reach = 2 * math.log(2) * (opacities.log2() - level_min)
    scale = math.sqrt(0.5 / math.log(2))
    w = scale * (xx / determinants).sqrt()
    fields = [*ellipses.means.unbind(1), scale / xx.sqrt(), -w * xy / xx, w, opacities.log2()]
    fields += [xy / yy, xy * (reach / xx).sqrt(), (reach * determinants / yy).sqrt()]
    fields += [expected.extents[:, 1], expected.extents[:, 0]]
    made = torch.cat([torch.stack(fields, 1), expected.channels], 1).detach()
    return torch.nn.functional.pad(made, (0, stride - made.shape[1]))


@pytest.mark.parametrize("name", SCENES)
def test_projected_splats_are_the_reference_s_ellipses_and_channels(name):
    scene = scene_of(name, torch.float64)
    found, expected = projected(scene), reference_of(*scene)
    assert torch.equal(found.visible, expected.visible.byte())
    assert not expected.visible.all() or len(expected.visible) == 1
    rows = found.projected[expected.rows]
    wanted = expected_splats(scene, rows.shape[1])
    # Without cut-offs a splat's ellipse has no end, and nobody asks for its shape.
    free = slice(7, 9) if SCENES[name].cut_offs is False else slice(0, 0)
    rows[:, free] = wanted[:, free] = 0
    torch.testing.assert_close(rows, wanted, rtol=1e-10, atol=1e-12)
    assert found.projected[~expected.visible].isnan().all()


@pytest.mark.parametrize("name", SCENES)
def test_rows_say_how_near_and_how_large_their_splats_are(name):
    scene = scene_of(name, torch.float64)
    found, expected = projected(scene), reference_of(*scene)
    depths, radii = torch.zeros_like(found.radii), torch.zeros_like(found.radii)
    depths[expected.rows] = expected.ellipses.depths.detach()
    radii[expected.rows] = expected.extents.detach().amax(1)
    keys = torch.where(expected.visible, depths.view(torch.int64), -1)
    near = (found.depth_keys - keys).abs() <= 4  # Units in the last place.
    assert near.all()
    torch.testing.assert_close(found.radii, radii, rtol=1e-12, atol=0)


def tiles_painted(splat: Tensor, columns: int, rows: int, level_min: float) -> int:
    """Tiles with a pixel centre, in the image or beyond it, at which alpha reaches its minimum."""
    y, x = torch.meshgrid(
        torch.arange(16 * rows) + 0.5, torch.arange(16 * columns) + 0.5, indexing="ij"
    )
    dx, dy = x - splat[0], y - splat[1]
    u, v = splat[2] * dx, splat[4] * dy + splat[3] * dx
    hit = (splat[5] - u * u - v * v >= level_min).nonzero() // 16
    return len(hit.unique(dim=0))


@pytest.mark.parametrize("name", ["SH in two parts", "channels", "no cut-offs"])
def test_tiles_are_counted_for_visible_splats_alone(name):
    scene = scene_of(name, torch.float64)
    found = projected(scene)
    assert (found.tile_counts[found.visible == 0] == 0).all()
    for splat, count in zip(found.projected, found.tile_counts.tolist(), strict=True):
        if not splat[0].isnan():
            grid = found.job.grid
            assert count == tiles_painted(splat, grid.columns, grid.rows, found.job.level_min)


def test_float_is_as_near_as_its_rounding():
    name = "SH in two parts"
    found = projected(scene_of(name, torch.float32))
    wide = scene_of(name, torch.float64)
    narrow = wide[0].map(lambda held: held.float().double())
    rows = reference_of(*wide).rows
    wanted = expected_splats((narrow, *wide[1:]), found.projected.shape[1])
    assert found.visible.nonzero()[:, 0].tolist() == rows.tolist()
    torch.testing.assert_close(found.projected[rows].double(), wanted, rtol=2e-4, atol=2e-5)
    depths = reference_of(*wide).ellipses.depths.detach()
    keys = found.depth_keys[rows].view(torch.float32).double()
    torch.testing.assert_close(keys, depths, rtol=1e-6, atol=0)
    assert (found.depth_keys[found.visible == 0] == -1).all()


def test_the_order_in_which_threads_run_changes_no_bit():
    scene = scene_of("SH in two parts", torch.float32)
    first = projected(scene)
    for seed in range(1, 9):
        again = projected(scene, EmulatedLauncher(seed=seed))
        for name in ("projected", "depth_keys", "tile_counts", "visible", "radii"):
            a, b = getattr(first, name), getattr(again, name)
            assert torch.equal(a.nan_to_num(-1), b.nan_to_num(-1)), name


def test_no_splat_is_no_launch():
    scene = (random_splats(0, 3), front_camera(), RenderSettings())
    assert len(projected(scene).radii) == 0


def test_coefficients_that_are_not_visible_are_not_read():
    splats = random_splats(40, 3)
    assert isinstance(splats.colors, Sh)
    splats.means[::2, 2] = -100
    splats.colors.coefficients[::2] = torch.nan
    found = projected((splats, front_camera(), RenderSettings()))
    assert found.projected[1::2, SPLAT_CHANNELS:].isfinite().all()
    assert (found.visible == torch.arange(40) % 2).all()


def test_offsets_that_lie_lead_nowhere_out_of_memory():
    splats = random_splats(40, 3)
    assert isinstance(splats.colors, Sh)
    colors = splats.colors.of_degrees(torch.arange(40) % 4).map(Tensor.contiguous)
    assert colors.offsets is not None
    colors.offsets[::3] = torch.tensor([-(10**12), 10**12]).repeat(7)
    found = projected((replace(splats, colors=colors), front_camera(), RenderSettings()))
    assert found.projected[found.visible == 1].isfinite().all()


def test_an_opacity_of_zero_is_drawn_where_nothing_is_cut_off():
    splats = replace(random_splats(5, 3), opacities=torch.zeros(5))
    settings = RenderSettings(profile=DEFAULT.without_cutoffs())
    found = projected((splats, front_camera(), settings))
    assert (found.visible == 1).all()
    assert found.projected[:, 5].isfinite().all()
