"""Which ellipse meets which tile, against trying every pixel."""

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.errors import ConfigError
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings
from gsfw.rasterizers.reference.bin import TILE, Bins, bin_ellipses
from gsfw.rasterizers.reference.project import Ellipses, project, reach


def ellipses_and_bins(count: int, width: int, height: int) -> tuple[Ellipses, Bins]:
    splats = random_splats(count, 0, seed=1, dtype=torch.float64)
    camera = front_camera(width, height, distance=3.0, dtype=torch.float64)
    ellipses = project(splats, camera, RenderSettings())
    return ellipses, bin_ellipses(ellipses, camera, DEFAULT, pairs_mb=64.0)


def reached_tiles(ellipses: Ellipses, width: int, height: int) -> set[tuple[int, int]]:
    """(tile, ellipse) wherever the ellipse overlaps the rectangle of the tile's pixel centres.

    Sampled densely along and within the rectangle instead of solved.
    """
    found = set()
    xx, xy, yy = ellipses.covariances.unbind(1)
    limit = reach(ellipses, DEFAULT)
    columns = -(-width // TILE)
    steps = torch.linspace(0.5, TILE - 0.5, 141, dtype=torch.float64)
    v, u = torch.meshgrid(steps, steps, indexing="ij")
    for tile in range(columns * -(-height // TILE)):
        x, y = u + tile % columns * TILE, v + tile // columns * TILE
        for i in range(len(xx)):
            dx, dy = x - ellipses.means[i, 0], y - ellipses.means[i, 1]
            q = yy[i] * dx * dx - 2 * xy[i] * dx * dy + xx[i] * dy * dy
            if (q / ellipses.determinants[i]).min() <= limit[i]:
                found.add((tile, i))
    return found


@pytest.mark.parametrize(("width", "height"), [(40, 30), (17, 31)])
def test_tiles_hold_exactly_the_ellipses_that_reach_them(width, height):
    ellipses, bins = ellipses_and_bins(40, width, height)
    tiles = torch.arange(len(bins.counts)).repeat_interleave(bins.counts)
    found = set(zip(tiles.tolist(), bins.ellipses[:-1].tolist(), strict=True))
    expected = reached_tiles(ellipses, width, height)
    assert expected <= found
    # Slack against rounding may add a pair that overlaps by less than the sampling resolves.
    assert len(found - expected) <= 2


def test_pairs_are_sorted_by_tile_and_then_from_front_to_back():
    _, bins = ellipses_and_bins(60, 40, 30)
    assert torch.equal(bins.starts, bins.counts.cumsum(0) - bins.counts)
    for start, count in zip(bins.starts.tolist(), bins.counts.tolist(), strict=True):
        members = bins.ellipses[start : start + count]
        assert (members.diff() > 0).all()
    assert bins.ellipses[-1] == 60, "the empty slot's ellipse is one past the last"


def test_sums_by_ellipse_are_those_of_their_pairs():
    _, bins = ellipses_and_bins(60, 40, 30)
    values = torch.randn(len(bins.ellipses), 3, dtype=torch.float64)
    expected = torch.zeros(61, 3, dtype=torch.float64).index_add_(0, bins.ellipses, values)[:60]
    torch.testing.assert_close(bins.sum_by_ellipse(values), expected)


def test_without_a_cut_off_every_ellipse_is_in_every_tile():
    ellipses, _ = ellipses_and_bins(5, 40, 30)
    bins = bin_ellipses(ellipses, front_camera(40, 30), DEFAULT.without_cutoffs(), pairs_mb=64.0)
    assert bins.counts.tolist() == [5] * 20
    assert bins.ellipses[:-1].tolist() == list(range(5)) * 20


def test_more_pairs_than_allowed_are_refused_with_their_bytes():
    ellipses, _ = ellipses_and_bins(50, 40, 30)
    camera = front_camera(40, 30)
    with pytest.raises(ConfigError) as caught:
        bin_ellipses(ellipses, camera, DEFAULT.without_cutoffs(), pairs_mb=0.01)
    assert str(caught.value) == (
        "this image needs 64000 bytes for 1000 pairs of a splat and a tile that it reaches; "
        "rasterizer.pairs_mb=0.01 does not allow that.\n"
        "Render a smaller image, keep splats from growing this large, or raise the limit."
    )
    with pytest.raises(ConfigError, match="does not allow that"):
        bin_ellipses(ellipses, camera, DEFAULT, pairs_mb=0.001)
