"""Contributions are what a splat adds to images, and pruning keeps the highest of them."""

from dataclasses import replace

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.scenes import front_camera, random_splats

from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.tradeoff.contribution import Kept, contributions, most_useful
from gsfw.studies.tradeoff.subject import Subject


class StillModel:
    """As much of a model as is asked of it here."""

    def __init__(self, splats):
        self._splats = splats

    def splats(self, time=None, cameras=None):
        return self._splats

    def cameras(self, cameras):
        return cameras

    def settings(self, settings):
        return settings


def test_contributions_are_what_each_splat_adds_to_the_images():
    splats = random_splats(8)
    cameras = [front_camera(), front_camera(distance=3.0)]
    rasterizer = ReferenceRasterizer()
    subject = Subject.__new__(Subject)  # The stand-in is no PrimitiveModel.
    for name, value in {
        "model": StillModel(splats),
        "rasterizer": rasterizer,
        "settings": RenderSettings(background=torch.ones(3)),
        "is_still": True,
        "read": None,
        "edits": (),
        "dtype": torch.float32,
        "shrink": 1,
        "float_bytes": 4,
    }.items():
        object.__setattr__(subject, name, value)
    told = []
    scores = contributions(subject, cameras, told.append)
    # A channel for each splat, in which it alone is 1: what is drawn is alpha times transmittance.
    alone = replace(splats, colors=torch.eye(8))
    expected = sum(rasterizer.render(alone, camera).color.sum((0, 1, 2)) for camera in cameras)
    torch.testing.assert_close(scores, expected.double(), rtol=1e-5, atol=1e-5)
    assert told == [1, 2]


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.sampled_from([0.0, 0.5, 1.0, 2.0, 7.0]), min_size=1, max_size=20),
    st.floats(0.01, 1.0),
)
def test_the_most_useful_rows_are_those_of_the_highest_scores(values, part):
    scores = torch.tensor(values, dtype=torch.float64)
    rows = most_useful(scores, part).tolist()
    assert rows == sorted(set(rows))
    assert len(rows) == max(1, round(part * len(values)))
    left_out = [value for row, value in enumerate(values) if row not in rows]
    assert all(values[row] >= value for row in rows for value in left_out)


def test_kept_rows_are_the_same_in_every_form_of_colours():
    splats = random_splats(6, degree=2)
    rows = torch.tensor([0, 2, 5])
    dense = Kept(rows)(splats)
    both = splats.colors.coefficients
    apart = Kept(rows)(replace(splats, colors=Sh(both[:, :1], 2, rest=both[:, 1:])))
    mixed = replace(splats, colors=splats.colors.of_degrees(torch.tensor([2, 1, 2, 0, 0, 2])))
    for kept in (dense, apart, Kept(rows)(mixed)):
        assert torch.equal(kept.means, splats.means[rows])
        assert torch.equal(kept.opacities, splats.opacities[rows])
        assert torch.equal(kept.colors.dense(), splats.colors.dense()[rows])
