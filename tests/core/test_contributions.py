"""Contributions are what a splat adds to images; the most useful rows have the highest."""

from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.scenes import front_camera, random_splats

from gsfw.core.contributions import Contributions, NoRowsError, most_useful_part
from gsfw.core.render_settings import RenderSettings
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

SETTINGS = RenderSettings(background=torch.ones(3))


def measured(splats_at, num_rows, cameras, most=0):
    return Contributions.of(splats_at, num_rows, cameras, ReferenceRasterizer(), SETTINGS, most)


def test_contributions_are_what_each_splat_adds_to_the_images():
    splats = random_splats(8)
    cameras = [front_camera(), front_camera(distance=3.0)]
    found = measured(lambda time, camera: splats, 8, cameras)
    # A channel for each splat, in which it alone is 1: what is drawn is alpha times transmittance.
    alone = replace(splats, colors=torch.eye(8))
    added = [ReferenceRasterizer().render(alone, camera).color.sum((0, 1, 2)) for camera in cameras]
    torch.testing.assert_close(found.total, sum(added).double(), rtol=1e-5, atol=1e-5)
    assert found.views.tolist() == sum((one >= 0.1).long() for one in added).tolist()


def test_rows_that_are_absent_at_the_time_of_a_view_add_nothing_to_it():
    splats = random_splats(8)
    few = replace(splats, rows=torch.arange(8)).take(torch.tensor([1, 4, 6]))
    cameras = [replace(front_camera(), time=torch.tensor([time])) for time in (0.0, 1.0)]
    found = measured(lambda time, camera: splats if time > 0.5 else few, 8, cameras)
    early = measured(lambda time, camera: few, 8, cameras[:1])
    late = measured(lambda time, camera: splats, 8, cameras[1:])
    assert early.total.nonzero()[:, 0].tolist() == [1, 4, 6]
    assert torch.equal(found.total, early.total + late.total)
    assert torch.equal(found.views, early.views + late.views)


def test_as_many_views_as_asked_for_are_measured_from_first_to_last():
    splats = random_splats(8)
    cameras = [front_camera(distance=2.0 + 0.1 * index) for index in range(5)]
    some = measured(lambda time, camera: splats, 8, cameras, most=3)
    same = measured(lambda time, camera: splats, 8, [cameras[index] for index in (0, 2, 4)])
    assert torch.equal(some.total, same.total)
    assert torch.equal(some.views, same.views)
    assert (measured(lambda time, camera: splats, 8, cameras).total >= some.total).all()


def test_each_view_is_measured_with_the_splats_of_its_camera():
    splats = random_splats(8)
    cameras = [front_camera(), front_camera(distance=3.0)]
    halves = {4.0: splats.take(torch.arange(4)), 3.0: splats.take(torch.arange(4, 8))}
    halves = {
        distance: replace(half, rows=torch.arange(4) + 4 * (distance == 3.0))
        for distance, half in halves.items()
    }

    def of_view(time, camera):
        return halves[float(camera.world_to_camera[0, 2, 3])]

    found = measured(of_view, 8, cameras)
    each = [measured(of_view, 8, [camera]).total for camera in cameras]
    assert torch.equal(found.total, each[0] + each[1])
    assert each[0][:4].any()
    assert not each[0][4:].any()


def test_splats_of_a_view_that_do_not_name_their_rows_are_refused():
    few = random_splats(3)
    with pytest.raises(
        NoRowsError, match="a view shows 3 splats of a model of 8 Gaussians"
    ) as caught:
        measured(lambda time, camera: few, 8, [front_camera()])
    assert "rows=rows" in caught.value.advice


@settings(max_examples=60)
@given(
    st.lists(st.sampled_from([0.0, 0.5, 1.0, 2.0, 7.0]), min_size=1, max_size=20),
    st.floats(0.01, 1.0),
)
def test_the_most_useful_rows_are_those_of_the_highest_scores(values, part):
    scores = torch.tensor(values, dtype=torch.float64)
    rows = most_useful_part(scores, part).tolist()
    assert rows == sorted(set(rows))
    assert len(rows) == max(1, round(part * len(values)))
    left_out = [value for row, value in enumerate(values) if row not in rows]
    assert all(values[row] >= value for row in rows for value in left_out)
