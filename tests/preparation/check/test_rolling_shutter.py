"""Shears of images, from exact matches of random points."""

from itertools import combinations

import numpy as np
import pytest
from support.checked_captures import looking_at

from gsfw.preparation.check.pose_agreement import Rig
from gsfw.preparation.check.rolling_shutter import row_shear
from gsfw.preparation.check.view_matches import ViewMatches

SIZE = np.array([400.0, 300.0])
FOCAL = 380.0
VIEWS = 12


def rig_of(generator: np.random.Generator) -> Rig:
    """Cameras all over the place, which look to about the middle."""
    centers = generator.normal(size=(VIEWS, 3)) + np.array([3.0, 0.0, 1.0])
    targets = 0.8 * generator.normal(size=(VIEWS, 3))
    poses = np.stack([looking_at(*pair) for pair in zip(centers, targets, strict=True)])
    matrix = np.array([[FOCAL, 0, SIZE[0] / 2], [0, FOCAL, SIZE[1] / 2], [0, 0, 1.0]])
    intrinsics = np.tile(matrix, (VIEWS, 1, 1))
    return Rig(poses[:, :3, :3], poses[:, :3, 3], intrinsics, np.tile(SIZE, (VIEWS, 1)))


def matches_of(rig: Rig, generator: np.random.Generator, shear: float, scale: float = 1.0):
    """Matches off by half a pixel; each image sheared to a side of its own, or all stretched."""
    points = 0.6 * generator.normal(size=(300, 3))
    local = np.einsum("vij,pj->vpi", rig.rotations, points) + rig.translations[:, None]
    pixels = scale * FOCAL * local[..., :2] / local[..., 2:] + SIZE / 2
    seen = ((pixels >= 0) & (pixels < SIZE)).all(2) & (local[..., 2] > 0.3)
    pixels += generator.normal(scale=0.5, size=pixels.shape)
    sides = shear * SIZE[0] * generator.choice((-1, 1), VIEWS)
    pixels[..., 0] += sides[:, None] * (pixels[..., 1] / SIZE[1] - 0.5)
    pairs, first, second, rows = [], [], [], []
    for i, j in combinations(range(VIEWS), 2):
        both = np.flatnonzero(seen[i] & seen[j])[:40]
        rows += [len(pairs)] * len(both)
        pairs.append((i, j))
        first.append(pixels[i, both])
        second.append(pixels[j, both])
    unmoved = np.zeros((VIEWS, VIEWS))
    return ViewMatches(
        np.arange(VIEWS), np.array(pairs), np.array(rows, np.int64), np.concatenate(first),
        np.concatenate(second), unmoved,
    )  # fmt: skip


@pytest.mark.parametrize("seed", [0, 1])
def test_a_shear_of_its_own_for_each_image_is_measured(seed):
    generator = np.random.default_rng(seed)
    rig = rig_of(generator)
    sheared = matches_of(rig, generator, 0.02)
    assert row_shear(sheared, rig) == pytest.approx(0.02, rel=0.2)
    assert row_shear(matches_of(rig, generator, 0.0), rig) is None


def test_a_focal_length_that_is_off_is_no_shear():
    generator = np.random.default_rng(2)
    rig = rig_of(generator)
    assert row_shear(matches_of(rig, generator, 0.0, scale=1.05), rig) is None
