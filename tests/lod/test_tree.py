"""The nodes of a tree have the moments of their Gaussians, and a cut covers each of these once."""

import pytest
import torch
from support.scenes import random_splats

from gsfw.core.cameras import Cameras
from gsfw.core.errors import ConfigError
from gsfw.core.maths.moments import areas
from gsfw.core.maths.rotations import rotation_matrices
from gsfw.lod.build import MOST_OPAQUE, build
from gsfw.lod.cut import Limits, select
from gsfw.lod.order import tree_order

COUNT = 300


@pytest.fixture(scope="module")
def splats():
    return random_splats(COUNT, 1, dtype=torch.float64)


@pytest.fixture(scope="module")
def tree(splats):
    return build(splats)


@pytest.fixture(scope="module")
def camera():
    return Cameras.look_at([0.3, -0.2, -1.5], width=64, height=48)


def covered(tree, numbers):
    """How many of the nodes are above each leaf, or the leaf itself."""
    found = torch.zeros(tree.count, dtype=torch.int64)
    for level, (start, size) in enumerate(zip(tree.starts, tree.sizes, strict=True)):
        here = numbers[(numbers >= start) & (numbers < start + size)] - start
        block = 1 << (len(tree.sizes) - 1 - level)
        for node in here.tolist():
            found[node * block : (node + 1) * block] += 1
    return found


@pytest.mark.parametrize("count", [1, 2, 3, 7, 64, 65, 1000])
def test_the_order_has_each_row_once(count):
    points = torch.randn(count, 3, generator=torch.Generator().manual_seed(0))
    assert torch.equal(tree_order(points).sort().values, torch.arange(count))


def test_rows_in_one_place_have_an_order():
    assert torch.equal(tree_order(torch.zeros(9, 3)).sort().values, torch.arange(9))


def test_the_halves_of_a_node_lie_on_two_sides():
    points = torch.randn(64, 3, generator=torch.Generator().manual_seed(0)) * torch.tensor(
        [9, 1, 1]
    )
    ordered = points[tree_order(points)]
    assert ordered[:32, 0].max() <= ordered[32:, 0].min()


@pytest.mark.parametrize(("level", "node"), [(0, 0), (3, 2), (5, 9)])
def test_a_node_has_the_moments_of_its_gaussians(tree, splats, level, node):
    block = 1 << (len(tree.sizes) - 1 - level)
    below = splats.take(tree_order(splats.means)[node * block : (node + 1) * block])
    masses = below.opacities * areas(below)
    shares = masses / masses.sum()
    mean = shares @ below.means
    sides = rotation_matrices(below.quats) * below.scales[:, None, :]
    apart = below.means - mean
    inside = sides @ sides.transpose(1, 2) + apart[:, :, None] * apart[:, None, :]
    covariance = torch.einsum("i,ijk->jk", shares, inside)
    (found,) = [tree.nodes(torch.tensor([tree.starts[level] + node])).splats()]
    sides = rotation_matrices(found.quats) * found.scales[:, None, :]
    assert torch.allclose(found.means[0].double(), mean, atol=1e-6)
    assert torch.allclose((sides @ sides.transpose(1, 2))[0].double(), covariance, rtol=1e-4)
    colors = torch.einsum("i,ikc->kc", shares, below.colors.dense().double())
    assert torch.allclose(found.colors.dense()[0].double(), colors, atol=1e-3)
    kept = min(float(masses.sum() / areas(found)), max(MOST_OPAQUE, float(below.opacities.max())))
    assert float(found.opacities) == pytest.approx(kept, rel=1e-4)


def test_the_last_level_is_the_model(tree, splats):
    leaves = tree.nodes(torch.arange(tree.starts[-1], tree.num_nodes)).splats()
    ordered = splats.take(tree_order(splats.means))
    assert torch.equal(leaves.means, ordered.means.float())
    assert torch.equal(leaves.opacities, ordered.opacities.float())


@pytest.mark.parametrize("most", [1, 2, 17, 150, COUNT, 10 * COUNT])
def test_a_cut_has_each_gaussian_once_and_keeps_its_budget(tree, most):
    cut = select(tree, None, Limits(most))
    assert len(cut) == min(most, COUNT)
    assert (covered(tree, cut) == 1).all()


@pytest.mark.parametrize("most", [1, 5, 40, 1000])
def test_a_cut_for_a_camera_lacks_only_what_it_does_not_see(tree, camera, splats, most):
    cut = select(tree, camera, Limits(most))
    found = covered(tree, cut)
    assert len(cut) <= most
    assert found.max() <= 1
    ordered = splats.take(tree_order(splats.means))
    pose, lens = camera.world_to_camera[0].double(), camera.intrinsics[0].double()
    seen = ordered.means @ pose[:3, :3].T + pose[:3, 3]
    pixels = seen @ lens.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    size = torch.tensor([64.0, 48.0])
    inside = (seen[:, 2] > 0) & (pixels >= 0).all(1) & (pixels <= size).all(1)
    assert inside.any()
    assert (found[inside] == 1).all()


def test_a_view_is_refined_where_it_is_near(tree):
    beside = Cameras.look_at([-3.0, 0, 0], width=64, height=64, field_of_view=100.0)
    cut = select(tree, beside, Limits(40))
    places = tree.places(cut)
    near = places[:, 0] < places[:, 0].median()
    assert places[near, 7].mean() < places[~near, 7].mean()


def test_a_size_in_pixels_ends_the_refinement(tree, camera):
    counts = [len(select(tree, camera, Limits(COUNT, pixels))) for pixels in (0.0, 5.0, 50.0, 1e9)]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > counts[2]
    assert counts[-1] == 1


def test_two_cameras_get_what_either_sees(tree, camera):
    other = Cameras.look_at([0.3, 0.2, 1.5], width=64, height=48)
    both = Cameras.from_matrices(
        torch.cat([camera.world_to_camera, other.world_to_camera]), camera.intrinsics[0], 64, 48
    )
    cut = select(tree, both, Limits(10 * COUNT))
    for one in (camera, other):
        assert torch.isin(select(tree, one, Limits(10 * COUNT)), cut).all()


def test_a_model_of_one_gaussian_is_its_own_tree(splats):
    tree = build(splats.take(torch.tensor([4])))
    assert select(tree, None, Limits(5)).tolist() == [0]


@pytest.mark.parametrize("limits", [(0, 0.0), (5, -1.0), (5, float("nan"))])
def test_limits_out_of_range_are_refused(limits):
    with pytest.raises(ConfigError, match="expected"):
        Limits(*limits)
