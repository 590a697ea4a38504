"""What is left out of a model whose images are known costs what it must."""

from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from support.scenes import front_camera, random_splats
from support.view_models import ByView

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Feature
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.learning_rate import LearningRate
from gsfw.core.metrics import PSNR_MAX
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene
from gsfw.methods.gaussians3d.initialisation import from_splats
from gsfw.methods.gaussians3d.model import StaticGaussians
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.requirements.worth import MOST_VIEWS, Worth
from gsfw.studies.tradeoff.subject import Subject

CPU = torch.device("cpu")
SETTINGS = RenderSettings(background=torch.zeros(3))
COLUMNS = ("means", "quats", "log_scales", "opacity_logits", "sh_dc", "sh_rest")


def gaussians(splats, degree=3, kind=StaticGaussians):
    """A model of these splats."""
    return kind(from_splats(splats, degree), {name: LearningRate(0.1) for name in COLUMNS})


class DrawnData(DataManager):
    """Its images are what a model looks like: without errors, PSNR is as high as it gets."""

    def __init__(self, model, views=2, times=0, held_out=True, hidden=None):
        self._times, self._hidden = times, hidden or {}
        self._views = []
        for number in range(views):
            moment = torch.tensor([number / max(views - 1, 1)]) if times else None
            self._views.append(replace(front_camera(24, 18, 4.0 + number), time=moment))
        self._held_out = held_out
        subject = subject_of(model, times)
        self._images = [
            subject.image(splats, camera)
            for splats, camera in zip(
                subject.splats_by_camera(self._views), self._views, strict=True
            )
        ]

    @property
    def scene(self):
        points = torch.zeros(0, 3)
        return Scene("drawn", points, points, torch.zeros(1, 3), 1.0, num_times=self._times)

    def views(self, split):
        if split is Split.EVAL and not self._held_out:
            return Views((), ())
        return Views(tuple(f"v{i}" for i in range(len(self._views))), tuple(self._views))

    def load(self, split, indices, device):
        views = self._views
        hidden = torch.zeros(1, 18, 24, 1, dtype=torch.bool)
        return [
            Batch(
                self._images[i][None],
                Cameras.cat([views[i]]),
                (i,),
                mask=hidden if i in self._hidden.get(split, ()) else None,
            )
            for i in indices
        ]


class Plain(ReferenceRasterizer):
    """Measures nothing, which is quick."""

    def capabilities(self):
        able = super().capabilities()
        return replace(able, features=able.features - {Feature.CONTRIBUTION})


def subject_of(model, times=0, kind=ReferenceRasterizer):
    return Subject(model, kind(), SETTINGS, is_still=not times)


def matte(count=12):
    """Splats of one colour from everywhere, that could have others."""
    return random_splats(count, degree=0)


def test_bands_of_a_matte_scene_buy_nothing():
    model = gaussians(matte())
    found = Worth.of(subject_of(model), DrawnData(model), CPU)
    assert found.psnr == PSNR_MAX
    assert found.bands == (0.0, 0.0, 0.0)
    assert found.views == ("v0", "v1")
    assert found.split is Split.EVAL
    assert found.motion is None


@pytest.mark.parametrize(
    ("hidden", "views", "split"),
    [((1,), ("v0", "v2"), Split.EVAL), ((0, 1, 2), ("v0", "v1", "v2"), Split.TRAIN)],
)
def test_views_that_masks_hide_are_not_compared(hidden, views, split):
    model = gaussians(matte())
    data = DrawnData(model, views=3, hidden={Split.EVAL: hidden})
    found = Worth.of(subject_of(model, kind=Plain), data, CPU)
    assert (found.views, found.split) == (views, split)


@pytest.mark.parametrize("band", [1, 2, 3])
def test_a_band_that_one_gaussian_uses_buys_what_all_of_psnr_is_above_the_others(band):
    model = gaussians(matte())
    with torch.no_grad():
        model.sh_rest.values[0, band * band - 1 : (band + 1) ** 2 - 1] = 0.5
    found = Worth.of(subject_of(model, kind=Plain), DrawnData(model), CPU)
    assert found.bands[band - 1] > 1.0
    assert [db for number, db in enumerate(found.bands, 1) if number != band] == [0.0, 0.0]


def test_bands_that_were_never_drawn_are_not_measured():
    model = gaussians(matte())
    model.active_degree = 1
    found = Worth.of(subject_of(model, kind=Plain), DrawnData(model), CPU)
    assert len(found.bands) == 1


def test_gaussians_that_nobody_sees_buy_nothing_and_the_others_do():
    splats = random_splats(20, degree=0)
    opacities = splats.opacities.clone()
    opacities[:5] = 1e-5  # A quarter, below what any pixel shows.
    model = gaussians(replace(splats, opacities=opacities), degree=0)
    found = Worth.of(subject_of(model), DrawnData(model), CPU)
    assert [item.part for item in found.least_useful] == [0.1, 0.25, 0.5]
    tenth, quarter, half = found.least_useful
    assert (tenth.bought_db, quarter.bought_db) == (0.0, 0.0)
    assert (tenth.contribution, quarter.contribution) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert half.bought_db > 1.0
    assert 0.0 < half.contribution < 0.5


@pytest.mark.parametrize("times", [0, 3])
def test_each_view_has_the_splats_of_its_camera(times):
    model = ByView(gaussians(matte(), degree=1))
    found = Worth.of(subject_of(model, times), DrawnData(model, times=times), CPU)
    assert found.psnr == PSNR_MAX
    assert found.bands == (0.0,)


class Sliding(StaticGaussians):
    """Moves to the side; late in the sequence only its second half is there, in other places."""

    def splats(self, time=None, cameras=None):
        splats = super().splats()
        if time is None:
            return splats
        splats = replace(splats, means=splats.means + time * torch.tensor([0.5, 0.0, 0.0]))
        rows = torch.arange(self.num_rows)
        return splats if time < 0.9 else replace(splats, rows=rows).take(rows[self.num_rows // 2 :])


def test_what_moves_is_worth_what_holding_it_still_costs():
    model = gaussians(matte(), degree=0, kind=Sliding)
    found = Worth.of(subject_of(model, times=3), DrawnData(model, times=3), CPU)
    assert found.psnr == PSNR_MAX
    assert found.motion.time == 0.5
    assert found.motion.bought_db > 1.0
    still = gaussians(matte(), degree=0)
    motion = Worth.of(subject_of(still, times=3), DrawnData(still, times=3), CPU).motion
    assert motion.bought_db == 0.0


def test_gaussians_of_a_moving_model_are_the_rows_of_the_model():
    """Rows of which some are absent at some times are told apart by their numbers."""
    model = gaussians(matte(), degree=0, kind=Sliding)
    with torch.no_grad():
        model.opacity_logits.values[:6] = -20.0
    found = Worth.of(subject_of(model, times=3), DrawnData(model, times=3), CPU)
    assert [item.bought_db for item in found.least_useful] == [0.0, 0.0, 0.0]
    assert found.least_useful[-1].contribution == pytest.approx(0.0, abs=1e-9)


def test_without_held_out_views_those_of_training_are_taken():
    model = gaussians(matte(), degree=0)
    found = Worth.of(subject_of(model, kind=Plain), DrawnData(model, held_out=False), CPU)
    assert found.split is Split.TRAIN
    assert found.psnr == PSNR_MAX


def test_few_views_of_many_are_looked_at_and_they_are_spread():
    model = gaussians(matte(4), degree=0)
    found = Worth.of(subject_of(model, kind=Plain), DrawnData(model, views=20), CPU)
    numbers = [int(name[1:]) for name in found.views]
    assert len(numbers) == MOST_VIEWS
    steps = [after - before for before, after in pairwise(numbers)]
    assert set(steps) <= {2, 3}


def test_a_rasterizer_that_measures_no_contributions_leaves_that_part_out():
    model = gaussians(matte(), degree=0)
    found = Worth.of(subject_of(model, kind=Plain), DrawnData(model), CPU)
    assert found.least_useful == ()
    assert found.psnr == PSNR_MAX


def test_ragged_colours_are_measured_up_to_the_highest_degree_that_any_has():
    splats = random_splats(6, degree=3)
    colors = splats.colors.of_degrees(torch.tensor([0, 2, 0, 1, 0, 0]))

    class Ragged(StaticGaussians):
        def splats(self, time=None, cameras=None):
            return replace(super().splats(), colors=colors)

    model = gaussians(splats, kind=Ragged)
    found = Worth.of(subject_of(model, kind=Plain), DrawnData(model), CPU)
    assert len(found.bands) == 2
    assert all(db > 0.1 for db in found.bands)
