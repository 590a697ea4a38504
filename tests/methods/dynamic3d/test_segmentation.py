"""Masks of the foreground: what rows learn from them, what stays, and refusals."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image
from support.gaussians import no_contributions, no_views
from support.masked_scene import HELD_OUT, write_masked_scene
from support.moving_splats import moving_scene
from support.resuming import resumed_to_the_same_bits
from support.scenes import front_camera
from support.tracked_splats import move_, tracked

from gsfw.commands.main import main
from gsfw.core.batch import SEGMENTATION, Batch, Resampling, ViewMap
from gsfw.core.context import StepContext
from gsfw.core.datamanager import Views
from gsfw.core.errors import ConfigError
from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.operators import Operators
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.datamanagers.panoptic import PanopticConfig
from gsfw.datamanagers.transforms import TransformsConfig
from gsfw.methods.dynamic3d.config import TrackedGaussiansConfig
from gsfw.methods.dynamic3d.model import TrackedGaussians
from gsfw.methods.dynamic3d.segmentation import intersection_over_union, mask_loss

MASKS = "datamanager.maps=segmentation:masks:nearest"
LOGITS = "canonical.extra.segmentation.values"


def segmented(moved: bool = True, **settings) -> TrackedGaussians:
    """20 rows at their second time, of which the first 8 are foreground."""
    model = tracked(**settings)
    model.add_segmentation(LearningRate(0.05))
    with torch.no_grad():
        model.canonical.extra[SEGMENTATION].values.copy_(torch.tensor([[2.0]] * 8 + [[-2.0]] * 12))
    model.advance_(0.0)
    if moved:
        move_(model, noise=0.05)
    model.advance_(1.0)
    if moved:
        move_(model, noise=0.05, seed=1)
    return model


def views(channels: int | None) -> Views:
    maps = {} if channels is None else {SEGMENTATION: channels}
    return Views(("a",), (replace(front_camera(), time=torch.zeros(1)),), maps=maps)


def begun(channels: int | None, **settings):
    method = TrackedGaussiansConfig(steps=100, **settings).build()
    model = method.build_model(moving_scene(), Operators(), torch.Generator(), None)
    method.begin(moving_scene(), views(channels), model)
    return method, model


def context(mask, extra, alpha=1.0, model=None, coverage=None) -> StepContext:
    """A rendered batch whose images have the shape of ``mask``."""
    image = torch.zeros(*mask.shape[:3], 3)
    statistics = RenderStatistics.zeros(torch.zeros(0, 3), len(mask), frozenset())
    maps = {SEGMENTATION: ViewMap.of(mask, Resampling.NEAREST)}
    return StepContext(
        step=0, steps=10,
        batch=Batch(image, front_camera(), (0,), maps=maps, alpha=coverage),
        splats=tracked().splats(),
        rendered=RenderOutput(image, torch.full_like(mask, alpha), statistics, extra=extra),
        target=image, num_rows=20 if model is None else model.num_rows, share=1.0, extent=2.0,
        operators=Operators(), render=no_views, contributions=no_contributions,
    )  # fmt: skip


def terms_of(model: TrackedGaussians) -> dict[str, torch.Tensor]:
    mask = torch.zeros(1, 30, 40, 1)
    return dict(model.regularizers(context(mask, mask, model=model)))


# The column.


def test_only_views_with_masks_give_rows_a_segmentation():
    for channels, settings in ((None, {}), (1, {"segmentation_weight": 0.0})):
        method, model = begun(channels, **settings)
        assert SEGMENTATION not in model.columns()
        assert model.foreground() is None
        assert model.splats().extra is None
        assert not any("masks" in note for note in method.notes(moving_scene()))
    method, model = begun(1)
    extra = model.splats(torch.tensor(0.5)).extra
    assert torch.equal(extra, torch.full((30, 1), 0.5)), "half at the start: unknown"
    assert "segmentation_weight=0 trains without masks." in method.notes(moving_scene())[-1]


def test_the_segmentation_is_trained_at_the_first_time_and_fixed_afterwards():
    method, model = begun(1)
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    method.prepare(0, model, optimizer, 0.0)
    assert optimizer.learning_rates(0)[SEGMENTATION] == 0.05
    method.prepare(30, model, optimizer, 0.5)
    assert optimizer.learning_rates(30)[SEGMENTATION] == 0.0


def test_masks_of_several_channels_are_refused_with_advice():
    with pytest.raises(ConfigError) as caught:
        begun(3)
    assert str(caught.value) == (
        "the per-view map 'segmentation' has 3 channels, and method 'dynamic3dgs' expects one: 1 "
        "where the foreground is, else 0.\n"
        "Convert the masks to grey images or to .npy files of the shape [height, width, 1], or "
        "train without them: segmentation_weight=0."
    )
    begun(3, segmentation_weight=0.0)


def test_data_that_may_have_masks_need_an_extra_channel():
    def channels(**settings) -> int:
        return TrackedGaussiansConfig(**settings).needs().extra_channels

    assert channels() == channels(datamanager=TransformsConfig(maps=("depth:d",))) == 0
    masked = TransformsConfig(maps=("segmentation:masks:nearest",))
    assert channels(datamanager=masked) == channels(datamanager=PanopticConfig()) == 1
    assert channels(datamanager=masked, segmentation_weight=0.0) == 0


# The losses.


def test_the_loss_is_zero_for_the_mask_itself_and_ignores_unknown_pixels():
    mask = (torch.rand(1, 30, 40, 1, generator=torch.Generator().manual_seed(0)) > 0.5).float()
    assert float(mask_loss(context(255 * mask, mask), 0.2)) == pytest.approx(0.0, abs=1e-6)
    assert float(mask_loss(context(mask, 1 - mask), 0.0)) == pytest.approx(1.0)
    unknown = mask.clone()
    unknown[:, :20] = torch.nan
    wrong_there = torch.cat([1 - mask[:, :20], mask[:, 20:]], dim=1)
    assert float(mask_loss(context(unknown, wrong_there), 0.0)) == pytest.approx(0.0)


def test_what_no_row_covers_is_neither_foreground_nor_background():
    mask = torch.ones(1, 30, 40, 1)
    nothing = torch.zeros_like(mask)
    for target in (mask, nothing):
        assert float(mask_loss(context(target, nothing, alpha=0.0), 0.0)) == pytest.approx(0.5)
    empty = context(mask, nothing, alpha=0.0, coverage=nothing)
    assert float(mask_loss(empty, 0.0)) == pytest.approx(0.0), "transparent images show no row"


def test_agreement_is_the_intersection_by_the_union():
    mask, found = torch.zeros(1, 4, 4, 1), torch.zeros(1, 4, 4, 1)
    given = context(mask, found)
    assert intersection_over_union(given.batch, given.rendered) == 1.0
    mask[:, :2], found[:, 1:3] = 1.0, 0.9
    given = context(mask, found)
    assert intersection_over_union(given.batch, given.rendered) == pytest.approx(4 / 12)


def test_only_background_rows_are_held_to_their_first_pose():
    model = segmented(moved=False)
    assert float(terms_of(model)["background"].detach()) < 1e-2, "16-bit quaternions"
    for rows, moves in ((slice(0, 8), False), (slice(8, 20), True)):
        model = segmented(moved=False)
        still = float(terms_of(model)["background"].detach())
        with torch.no_grad():
            model.canonical.means.values[rows, 0] += 0.5
        change = float(terms_of(model)["background"].detach()) - still
        # The weight is 20 and the extent 2.
        assert change == pytest.approx(20 * 0.25 if moves else 0.0, abs=1e-6)
    weightless = terms_of(segmented(background_weight=0.0))["background"]
    assert float(weightless.detach()) == 0.0


def test_background_rows_have_no_neighbours():
    model = segmented()
    terms = terms_of(model)
    sum(terms[name] for name in ("rigid", "rotation", "isometry")).backward()
    for column in (model.canonical.means, model.canonical.quats):
        rows = column.values.grad.abs().sum(1)
        assert bool((rows[:8] > 0).all())
        assert not bool(rows[8:].any())


@pytest.mark.parametrize("logit", [-2.0, 2.0])
def test_scenes_of_one_kind_of_rows_only_have_finite_losses(logit):
    model = segmented()
    with torch.no_grad():
        model.canonical.extra[SEGMENTATION].values.fill_(logit)
    terms = terms_of(model)
    assert ("rigid" in terms) == (logit > 0)
    assert all(bool(term.isfinite()) for term in terms.values())
    if logit > 0:
        assert float(terms["background"].detach()) == 0.0


def test_children_are_of_the_kind_of_their_parents():
    model = segmented()
    children = model.split_rows(torch.tensor([0, 19]), 2, torch.Generator())
    assert children[SEGMENTATION].values.flatten().tolist() == [2.0, -2.0, 2.0, -2.0]
    tried = model.rows_at(torch.zeros(1, 3), torch.zeros(1, 3), torch.ones(1), 0.0)
    assert tried[SEGMENTATION].values.tolist() == [[0.0]]


# Whole runs.


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write_masked_scene(tmp_path_factory.mktemp("scene") / "data")


def train(scene, out, *arguments):
    """80 steps, 50 of them at the first time."""
    given = ("steps=80", "sampler.first_steps=50", "eval_every=0", "seed=3", "strategy=none")
    given += (HELD_OUT, "datamanager.masks=none", "device=cpu", MASKS, f"out={out}", *arguments)
    assert main(["train", "method=dynamic3dgs", f"data={scene}", *given]) == 0
    return json.loads(RunFolder(out).summary.read_text())


def state_of(out, step=80):
    return read_checkpoint(RunFolder(out).checkpoint(step))


@pytest.mark.slow
def test_rows_learn_the_mask_and_the_background_stays(scene, tmp_path):
    figures = train(scene, tmp_path / "run")
    assert figures["skipped_steps"] == 0
    assert figures["segmentation_iou"] > 0.4
    model = state_of(tmp_path / "run")["model"]
    foreground = model[LOGITS][:, 0] >= 0
    assert 40 < int(foreground.sum()) < 200
    first = model["trajectory.stacks.past_means.values"][0]
    moved = (model["canonical.means.values"] - first).norm(dim=1)
    assert float(moved[~foreground].median()) < 0.1 * float(moved[foreground].median())


@pytest.mark.slow
def test_a_run_with_masks_resumes_and_is_exported_as_it_is(scene, tmp_path):
    run = tmp_path / "run"
    train(scene, run, "checkpoint_every=64")
    resumed_to_the_same_bits(run)
    file = tmp_path / "model.gsfw"
    assert main(["export", str(run), "format=gsfw", f"out={file}"]) == 0
    assert main(["export", str(run), "format=ply", f"out={tmp_path / 'run.ply'}"]) == 0
    assert main(["export", str(file), "format=ply", f"out={tmp_path / 'file.ply'}"]) == 0
    assert (tmp_path / "run.ply").read_bytes() == (tmp_path / "file.ply").read_bytes()


@pytest.mark.slow
def test_a_mask_of_other_proportions_is_refused_with_advice(tmp_path, capsys):
    scene = write_masked_scene(tmp_path / "data")
    Image.fromarray(np.zeros((24, 24), np.uint8)).save(scene / "masks" / "train_005.png")
    arguments = ["train", "method=dynamic3dgs", f"data={scene}", MASKS, "datamanager.masks=none"]
    assert main([*arguments, f"out={tmp_path / 'run'}"]) == 2
    said = capsys.readouterr().err
    assert "train_005.png: the map is 24x24 pixels with 1 channel, its image is" in said
    assert "the proportions of the (upright) image" in said
