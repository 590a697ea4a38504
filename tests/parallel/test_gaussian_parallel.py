"""Gaussian parallelism: rows and images are divided among processes, and no bit changes by that.

Threads stand for processes here; tests/parallel/test_processes.py has real ones.
"""

from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from support.fast_rasterizer import fast_rasterizer
from support.gaussians import gaussians
from support.memory_training import Recorder, trainer, with_parts
from support.scenes import front_camera
from support.states import assert_same_bits, without_clock
from support.thread_group import in_threads

from gsfw.core.errors import ConfigError, UserError
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.render_settings import RenderSettings, Statistic
from gsfw.parallel.sharded.division import TILE, Division
from gsfw.parallel.sharded.team import GaussianParallel
from gsfw.parallel.sharded.views import Views
from gsfw.parallel.sharded.window import Window

# Whole trainings; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

SHARDS = 4


def divided(run, group):
    """The trainer of one process, with its share of the rows."""
    team = GaussianParallel(group, SHARDS)
    team.check(run.parts)
    parts = team.share(run.parts)
    return with_parts(run, team=team, table=parts.table, edited=parts.edited)


def checkpoint(folder):
    return without_clock(read_checkpoint(max((folder / "checkpoints").glob("*.pt"))))


def trained(folder, size, strategy="adc", resume=False, stop=None, steps=40, **options):
    """The checkpoint, and the summary and reports of each process."""

    def run(group):
        recorder = Recorder(stop)
        own = divided(trainer(folder, strategy, recorder, steps=steps, **options), group)
        if resume:
            own.load_state_dict(read_checkpoint(max((folder / "checkpoints").glob("*.pt"))))
        return own.fit(), recorder.reports, own

    results = in_threads(size, run)
    return checkpoint(folder), results


def test_two_processes_train_the_bits_of_one(tmp_path):
    one, _ = trained(tmp_path / "1", 1, steps=16)
    two, ((summary, _, _), _) = trained(tmp_path / "2", 2, steps=16)
    assert_same_bits(one, two)
    assert summary["num_gaussians"] > 100, "refiners have edited rows"


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["adc", "absgrad", "mcmc"])
def test_any_number_of_processes_trains_the_same_bits(tmp_path, strategy):
    one, ((summary, _, _),) = trained(tmp_path / "1", 1, strategy, views_per_step=2)
    for size in (2, 3):
        several, results = trained(tmp_path / str(size), size, strategy, views_per_step=2)
        assert_same_bits(one, several)
        assert results[0][0]["psnr"] == summary["psnr"]
        assert results[0][0]["num_gaussians"] == summary["num_gaussians"] > 100


@pytest.mark.slow
def test_a_run_goes_on_with_another_number_of_processes(tmp_path):
    one, _ = trained(tmp_path / "one", 1)
    trained(tmp_path / "two", 2, stop=17)
    several, _ = trained(tmp_path / "two", 3, resume=True)
    assert_same_bits(one, several)


@pytest.mark.slow
def test_rows_are_shared_evenly_after_every_refinement(tmp_path):
    _, results = trained(tmp_path, 3, steps=16)
    counts = [own.parts.team.counts for _, _, own in results[1:]]
    held = [own.parts.model.num_rows for _, _, own in results]
    assert held[0] == sum(counts[0])  # The first process has all of them in the end.
    assert held[1:] == counts[0][1:]
    # Three processes have one, one and two shards, of sizes that differ by one row at most.
    assert max(counts[0]) - 2 * min(counts[0]) <= 2


def test_the_first_step_is_that_of_one_process_up_to_rounding(tmp_path):
    alone = trainer(tmp_path / "alone", "none", Recorder(), steps=1)
    alone.fit()

    def run(group):
        own = divided(trainer(tmp_path / "divided", "none", Recorder(), steps=1), group)
        own.fit()

    in_threads(2, run)
    found = checkpoint(tmp_path / "divided")
    for name, values in alone.state_dict()["optimizer"]["moments"].items():
        torch.testing.assert_close(
            found["optimizer"]["moments"][name][0]["first"], values[0]["first"], msg=name
        )


@pytest.mark.slow
def test_losses_are_reported_as_by_one_process(tmp_path):
    _, ((_, one, _),) = trained(tmp_path / "1", 1, "mcmc", steps=16)
    _, ((_, two, _), _) = trained(tmp_path / "2", 2, "mcmc", steps=16)
    assert [report.num_gaussians for report in two] == [report.num_gaussians for report in one]
    for first, second in zip(one, two, strict=True):
        assert second.losses == pytest.approx(first.losses, rel=1e-6)


def test_the_bytes_of_an_image_are_those_of_the_formula():
    pytest.importorskip("gsfw.kernels.cpu._native", reason="flat splats have other sizes")
    size, rows, side = 3, 240, 64
    camera = front_camera(side, side)
    settings = RenderSettings(statistics=frozenset({Statistic.SCREEN_GRADIENT}))

    def render(group):
        model = gaussians(rows)
        own = Division(SHARDS, size).rows_of(group.rank, rows)
        for column in model.columns().values():
            column.assign(column.take(torch.arange(own.start, own.stop)))
        division = Division(SHARDS, size)
        views = Views(group, division, model, fast_rasterizer(), camera, settings, None, rows)
        views.output.color.sum().backward()
        views.back()
        bands = range(len(division.bands(side)))
        there = [sum(shard.banded.counts[band] for shard in views.shards) for band in bands]
        own_bands = [band for band in bands if division.owner(0, band) == group.rank]
        out = sum(there[band] for band in bands if band not in own_bands)
        back = sum(sum(band.counts) for band in views.bands) - sum(there[b] for b in own_bands)
        banded, pixels = views.shards[0].banded, sum(map(_pixels, views.bands))
        return group.bytes_sent, pixels, out, back, banded.rows.shape[1], banded.num_sums

    found = in_threads(size, render)
    for sent, pixels, out, back, values, sums in found:
        images = 4 * 4 * pixels * (size - 1)  # Four channels, to each of the others.
        counts = sent - images - 4 * values * out - 4 * sums * back
        assert 0 <= counts <= 8 * SHARDS * size
        assert (values, sums) == (15, 9)
    assert sum(line[1] for line in found) == side * side
    assert sum(line[2] for line in found) == sum(line[3] for line in found) > 0


def _pixels(band) -> int:
    return band.rendered.alpha.numel()


@given(rows=st.integers(0, 5000), shards=st.integers(1, 40), size=st.integers(1, 40))
def test_every_row_is_in_one_shard_and_one_process(rows, shards, size):
    size = min(size, shards)
    division = Division(shards, size)
    held = [row for rank in range(size) for row in division.rows_of(rank, rows)]
    assert held == list(range(rows))
    lengths = [
        division.start(shard + 1, rows) - division.start(shard, rows)
        for rank in range(size)
        for shard in division.shards_of(rank)
    ]
    assert len(lengths) == shards
    assert max(lengths) - min(lengths) <= 1


@given(height=st.integers(1, 3000), shards=st.integers(1, 40), size=st.integers(1, 40))
def test_every_row_of_pixels_is_in_one_band_of_whole_tiles(height, shards, size):
    size = min(size, shards)
    division = Division(shards, size)
    bands = division.bands(height)
    assert [row for band in bands for row in band] == list(range(height))
    assert all(band.start % TILE == 0 for band in bands)
    assert len(bands) <= shards
    owners = [division.owner(image, band) for image in range(3) for band in range(len(bands))]
    counts = [owners.count(rank) for rank in range(size)]
    assert sum(counts) == 3 * len(bands)
    assert max(counts) <= 3 * -(-len(bands) // size)


def refusal(tmp_path, change=None, size=1, strategy="none"):
    def run(group):
        own = trainer(tmp_path, strategy, Recorder())
        if change is not None:
            change(own)
        with pytest.raises(ConfigError) as refused:
            divided(own, group)
        return str(refused.value)

    return in_threads(size, run)[0]


def test_a_model_whose_rows_depend_on_others_is_refused(tmp_path):
    def mixed(run):
        run.parts.model.divisible = False

    assert "rows of StaticGaussians depend on other rows" in refusal(tmp_path, mixed)


def test_more_processes_than_shards_are_refused(tmp_path):
    message = refusal(tmp_path, size=5)
    assert message == (
        "shards=4 cannot be divided among 5 processes.\n"
        "Train with processes=4 at most, or with shards=5 in a new run."
    )


def test_a_strategy_that_watches_the_backward_pass_is_refused(tmp_path):
    message = refusal(tmp_path, strategy="error")
    assert "watches the backward pass" in message
    assert "Train with processes=0 shards=0, or" in message, "shards alone divide images, too"


def test_a_band_with_too_many_pairs_is_named_with_its_cause():
    rasterizer = fast_rasterizer()
    rasterizer.pairs_mb = 1e-4

    def render(group):
        model, camera, settings = gaussians(240), front_camera(64, 64), RenderSettings()
        with pytest.raises(UserError, match=r"^band 0 of the step: .*pairs_mb=0.0001") as caught:
            Views(group, Division(SHARDS, 1), model, rasterizer, camera, settings, None, 240)
        assert type(caught.value) is UserError, "the last finished step is kept after it"

    in_threads(1, render)


def test_splats_of_a_wrong_form_are_named_as_by_one_process():
    def render(group):
        model, camera, settings = gaussians(240), front_camera(64, 64), RenderSettings()
        model.splats = lambda time, cameras: None  # type: ignore[assignment,method-assign]
        with pytest.raises(ConfigError, match=r"Gaussians\.splats returned NoneType, expected Sp"):
            Views(group, Division(SHARDS, 1), model, fast_rasterizer(), camera, settings, None, 240)

    in_threads(1, render)


def test_refined_poses_get_gradients_of_all_shards_of_a_process():
    camera = front_camera(64, 64)
    pose = camera.world_to_camera.clone().requires_grad_()
    camera = replace(camera, world_to_camera=pose * 1.0)
    model, whole = gaussians(240), fast_rasterizer()
    (expected,) = torch.autograd.grad(
        whole.render(model.splats(None, camera), camera).color.square().sum(),
        pose,
        retain_graph=True,
    )

    def back(group):
        team = GaussianParallel(group, SHARDS)
        team.num_rows = 240
        rendering = team.render(model, whole, camera, RenderSettings(), None)
        rendering.output.color.square().sum().backward()
        (views,) = team._open
        views.back()
        for place in range(SHARDS):
            team._shard_backward(place, [], 1.0)

    in_threads(1, back)
    torch.testing.assert_close(pose.grad, expected, rtol=1e-4, atol=1e-4)


def test_gradients_of_one_shard_are_taken_without_a_copy_and_have_the_bits_of_several():
    def gradients(ends):
        model = gaussians(6)
        windows = [Window(model, *pair) for pair in ends]
        given = torch.linspace(-1, 1, 18).view(6, 3)
        given[2] = -0.0
        found = []
        for window in windows:
            with window.shown():
                (model.means.values * given[window.start : window.stop]).sum().backward()
                found.append(model.means.values.grad.data_ptr())
            window.add_gradients()
        return model.means.values.grad, found

    one, (place,) = gradients([(0, 6)])
    two, _ = gradients([(0, 2), (2, 6)])
    assert one.data_ptr() == place
    assert torch.equal(one.view(torch.int32), two.view(torch.int32))


def test_splats_are_forgotten_once_they_are_sent():
    def rows_kept(group):
        division, model = Division(SHARDS, 2), gaussians(40)
        own = division.rows_of(group.rank, 40)
        for column in model.columns().values():
            column.assign(column.take(torch.arange(own.start, own.stop)))
        camera = front_camera(64, 64)
        views = Views(group, division, model, fast_rasterizer(), camera, RenderSettings(), None, 40)
        assert sum(len(shard.banded.counts) for shard in views.shards) > 0
        return sum(len(shard.banded.rows) for shard in views.shards), views.output.alpha.max()

    for kept, alpha in in_threads(2, rows_kept):
        assert kept == 0
        assert alpha > 0
