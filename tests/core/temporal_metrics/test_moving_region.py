"""Which pixels move: as the data says, else where pictures of one fixed camera vary."""

import torch
from support.moving_scene import WHITE, MovingImages

from gsfw.core.datamanager import Split
from gsfw.core.temporal_metrics.moving_region import (
    FROM_MASKS,
    FROM_VARIANCE,
    UNKNOWN,
    MovingRegions,
    camera_key,
)

CPU = torch.device("cpu")


def regions(data, split=Split.EVAL):
    return MovingRegions(data, split, WHITE.background, CPU)


def test_the_pictures_of_a_fixed_camera_show_what_moves_by_their_variance():
    data = MovingImages([(0.0, 3.0), (0.5, 3.0), (1.0, 3.0)])
    region = regions(data).find(1)
    assert region.source == FROM_VARIANCE
    assert region.mask.shape == (24, 32, 1)
    rows = region.mask[..., 0].any(dim=1).nonzero()[:, 0]
    columns = region.mask[..., 0].any(dim=0).nonzero()[:, 0]
    # The red ball drifts along the upper half from left to right; the blue one below stands still.
    assert rows.max() < 14
    assert columns.min() < 10
    assert columns.max() > 20


def test_the_variance_is_that_of_the_stack_of_pictures():
    data = MovingImages([(0.0, 3.0), (0.3, 3.0), (1.0, 3.0)])
    stack = torch.cat(data.images[Split.EVAL]).double()
    expected = stack.std(dim=0, unbiased=False).amax(-1, keepdim=True) > 0.02
    assert torch.equal(regions(data).find(0).mask, expected)


def test_pictures_of_the_same_camera_that_were_trained_on_count_too():
    alone = MovingImages([(0.5, 3.0), (0.6, 3.0)])
    more = MovingImages([(0.5, 3.0), (0.6, 3.0)], train=((0.0, 3.0), (1.0, 3.0)))
    assert regions(more).find(0).mask.sum() > 1.3 * regions(alone).find(0).mask.sum()


def test_a_mask_of_the_data_goes_before_variance():
    mask = torch.zeros(24, 32, 1, dtype=torch.bool)
    mask[3, 4] = True
    found = regions(data := MovingImages([(0.0, 3.0), (1.0, 3.0)], mask=mask))
    assert found.find(0).source == FROM_MASKS
    assert torch.equal(found.find(1).mask, mask)
    assert found.sources() == "masks of the data set (0.1% of the pixels)"
    assert data.mask is mask


def test_where_each_time_has_another_camera_the_region_is_unknown():
    found = regions(MovingImages([(0.0, 3.0), (0.5, 3.1), (1.0, 3.2)]))
    assert [found.find(index).mask for index in range(3)] == [None, None, None]
    assert found.find(0).source == UNKNOWN
    assert found.sources() == UNKNOWN


def test_the_note_counts_views_where_they_differ():
    found = regions(MovingImages([(0.0, 3.0), (1.0, 3.0), (0.5, 3.3)]))
    for index in range(3):
        found.find(index)
    assert found.sources().startswith(f"2 views: {FROM_VARIANCE}; 1 views: {UNKNOWN} (")


def test_views_of_one_place_at_one_time_do_not_vary():
    found = regions(MovingImages([(0.5, 3.0), (0.5, 3.0)]))
    assert found.find(0).source == UNKNOWN


def test_a_camera_is_known_by_pose_lens_and_size():
    data = MovingImages([(0.0, 3.0), (1.0, 3.0), (0.0, 3.1)])
    first, second, third = data.views(Split.EVAL).cameras
    assert camera_key(first) == camera_key(second)
    assert camera_key(first) != camera_key(third)
    assert camera_key(first) != camera_key(first.resized(16, 12))
