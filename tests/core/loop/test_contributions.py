"""Contributions by view: each row has its own, and rows that are absent at the time have none."""

from dataclasses import replace

import torch
from support.scenes import front_camera, random_splats

from gsfw.core.loop.contributions import highest_rows, view_contributions
from gsfw.core.render_settings import RenderSettings
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer


def test_each_view_is_measured_at_its_time_and_absent_rows_add_nothing():
    splats, camera = random_splats(6), front_camera()
    late = replace(splats.take(torch.tensor([4, 1])), rows=torch.tensor([4, 1]))
    cameras = [camera, replace(camera, time=torch.tensor([0.5]))]
    whole, part = view_contributions(
        cameras, lambda time: splats if time is None else late, ReferenceRasterizer(),
        RenderSettings(), 6,
    )  # fmt: skip
    assert whole.dtype == part.dtype == torch.float64
    expected = ReferenceRasterizer().contributions(splats, camera)[0].double()
    assert torch.equal(whole, expected)
    assert part.nonzero()[:, 0].tolist() == [1, 4]
    assert torch.equal(part[[4, 1]], ReferenceRasterizer().contributions(late, camera)[0].double())


def test_the_highest_rows_come_in_their_order_and_the_first_of_equal_ones():
    assert highest_rows(torch.tensor([1.0, 3.0, 2.0, 3.0, 2.0]), 3).tolist() == [1, 2, 3]
