"""Bands come where colours need them, and go where they do the least."""

import itertools
import json
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.gaussians import context_of, table_of
from support.refining import refine
from support.resuming import HALF, resumes_to_the_same_bits
from support.scenes import front_camera, random_splats

from gsfw.commands.main import main
from gsfw.core.errors import ConfigError
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.splats import Sh
from gsfw.formats.ply import PlyImporter
from gsfw.methods.dynamic3d.config import TrackedGaussiansConfig
from gsfw.methods.gaussians3d.adaptive_bands import AdaptiveBands, thinned
from gsfw.methods.gaussians3d.config import BandsConfig, StaticGaussiansConfig
from gsfw.methods.gaussians3d.initialisation import degrees_of, from_splats
from gsfw.methods.gaussians3d.model import StaticGaussians
from gsfw.methods.gaussians4d.config import DeformationConfig
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

SIZES = torch.tensor([0, 3, 8, 15])
ADAPTIVE = ("sh=adaptive", "bands.every=4", "bands.grow_stop=12", "bands.stop=18", "bands.signal=1")


def adaptive(degrees, degree=3, seed=0) -> StaticGaussians:
    """A model whose rows have these degrees."""
    start = from_splats(random_splats(len(degrees), degree=degree, seed=seed), degree)
    rates = StaticGaussiansConfig(sh="adaptive").learning_rates(1.0)
    return StaticGaussians(start, rates, torch.as_tensor(degrees))


def bands(model=None, views=4, share=0.4) -> AdaptiveBands:
    config = BandsConfig(share, signal=2.0, every=10, grow_stop=30, stop=60)
    return AdaptiveBands(config, adaptive([0]) if model is None else model, views)


def cost(model, degrees) -> float:
    """The squared error of the images when rows are cut at ``degrees``."""
    rows = (
        model.sh_rest.values.detach()
        .double()
        .square()
        .sum(1)
        .split(model.sh_rest.offsets.diff().tolist())
    )
    lost = [
        float(row[size:].sum()) for row, size in zip(rows, SIZES[degrees].tolist(), strict=True)
    ]
    return float(torch.tensor(lost, dtype=torch.float64) @ model.evidence.weights.values.double())


@settings(max_examples=30)
@given(
    degrees=st.lists(st.integers(0, 3), min_size=1, max_size=5),
    part=st.floats(0, 1),
    seed=st.integers(0, 1000),
)
def test_no_other_degrees_with_as_few_floats_cost_less(degrees, part, seed):
    model = adaptive(degrees, seed=seed)
    generator = torch.Generator().manual_seed(seed)
    model.evidence.weights.values.copy_(torch.rand(len(degrees), generator=generator))
    before = torch.tensor(degrees)
    found = thinned(model, part * float(SIZES[before].sum()))
    floats = int(SIZES[found].sum())
    assert floats <= part * float(SIZES[before].sum())
    assert bool((found <= before).all())
    for other in itertools.product(*(range(degree + 1) for degree in degrees)):
        candidate = torch.tensor(other)
        if int(SIZES[candidate].sum()) <= floats:
            assert cost(model, found) <= cost(model, candidate) * (1 + 1e-9) + 1e-12


def test_what_fits_stays_as_it_is():
    model = adaptive([0, 1, 2, 3])
    assert thinned(model, 26.0).tolist() == [0, 1, 2, 3]


def test_bands_that_no_view_pulls_at_go_first():
    model = adaptive([3, 3, 3])
    model.evidence.weights.values.copy_(torch.tensor([1.0, 0.0, 1.0]))
    assert thinned(model, 30.0).tolist() == [3, 0, 3]


def test_evidence_is_gathered_in_the_steps_before_a_round():
    plan = bands()
    gathered = [step for step in range(100) if plan.needs_view_gradients(step)]
    assert gathered == [
        step for last in (9, 19, 29, 39, 49, 59) for step in range(last - 3, last + 1)
    ]
    assert not bands(views=1000).needs_view_gradients(0), "the step before, in which room is made"
    assert bands(views=1000).needs_view_gradients(1)


def test_rows_gain_the_band_that_their_gradients_ask_for():
    model = adaptive([0, 1, 3, 0])
    _, table = table_of(model)
    plan, camera = bands(model), front_camera()
    for step in range(10):
        splats = model.splats()
        context = context_of(ReferenceRasterizer().render(splats, camera).statistics, 4, step)
        plan.before_backward(replace(context, splats=splats), model)
        if step == 8:
            # As if all views pulled the first two rows the same way, and the last one at random.
            lengths = model.evidence.sums.offsets.diff()
            assert lengths.tolist() == [3, 5, 0, 3]
            model.evidence.sums.values[:8] = torch.tensor([[5.0], [5.0]])
            model.evidence.sums.values[8:] = torch.tensor([[1.0], [5.0]])
        done = refine(plan, step, table, model)
    assert done == {"bands_gained": 2, "bands_lost": 0}
    assert model.degrees().tolist() == [1, 2, 3, 0]
    assert model.evidence.sums.values.numel() == 0, "room is there only while it is needed"


def test_rounds_end_with_the_share_that_was_asked_for():
    model = adaptive([3] * 40)
    _, table = table_of(model)
    model.evidence.weights.values.fill_(1.0)
    plan, floats = bands(model), []
    for step in range(80):
        if (step + 1) % 10 == 0:
            model.evidence.weights.values.fill_(1.0)
        refine(plan, step, table, model)
        floats.append(3 * 40 + model.sh_rest.values.numel())
    full = 3 * 16 * 40
    assert floats[29] == full
    assert full > floats[39] > floats[49] > floats[59]
    assert 0.37 * full <= floats[59] <= 0.4 * full
    assert floats[79] == floats[59]


def test_what_stays_keeps_its_values_and_moments():
    model = adaptive([3, 3, 3])
    optimizer, table = table_of(model)
    before = model.sh_rest.values.detach().clone()
    model.evidence.weights.values.copy_(torch.tensor([1.0, 0.0, 1.0]))
    refine(bands(model, share=0.7), 59, table, model)
    assert model.degrees().tolist() == [3, 0, 3]
    assert torch.equal(model.sh_rest.values, torch.cat([before[:15], before[30:]]))
    assert optimizer.moments("sh_rest")[0].first.shape == (30, 3)
    assert float(optimizer.moments("sh_rest")[0].first.min()) == 1.0


def test_new_rows_have_one_colour_and_children_the_bands_of_their_parents():
    model = adaptive([2, 0, 1])
    _, table = table_of(model)
    table.append(model.rows_at(torch.zeros(2, 3), torch.ones(2, 3), torch.ones(2), None))
    table.append(model.split_rows(torch.tensor([0, 2]), 2, torch.Generator()))
    table.append(model.clone_rows(torch.tensor([1])))
    assert model.degrees().tolist() == [2, 0, 1, 0, 0, 2, 1, 2, 1, 0]


def test_splats_of_a_file_begin_with_the_bands_they_have():
    sh = torch.zeros(4, 16, 3)
    sh[1, 2, 0], sh[2, 8, 1], sh[3, 9, 2] = 1.0, -1.0, 1e-9
    assert degrees_of(sh).tolist() == [0, 1, 2, 3]


def test_nothing_is_drawn_of_bands_that_no_row_has():
    colors = adaptive([0, 0]).splats().colors
    assert isinstance(colors, Sh)
    assert colors.degree == 0
    assert colors.rest is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("strategy", "method"),
    [
        ("adc", ("method=3dgs", "ignore_time=true")),
        ("mcmc", ("method=3dgs", "ignore_time=true")),
        ("adc", ("method=spacetime", "static=auto", "static_start=2", "static_every=5")),
        ("adc", ("method=spacetime", "static=none")),
        ("mcmc", ("method=4dgs", "coarse_steps=4")),
        ("adc", ("method=4d-rotor",)),
    ],
    ids=["3dgs, adc", "3dgs, mcmc", "spacetime, static=auto", "spacetime", "4dgs", "4d-rotor"],
)
def test_a_run_with_colours_of_all_degrees_resumes_to_the_same_bits(tmp_path, strategy, method):
    refined = ("strategy.refine_start=2", "strategy.refine_every=5")
    resumes_to_the_same_bits(tmp_path, *method, *ADAPTIVE, f"strategy={strategy}", *refined)
    whole = RunFolder(tmp_path / "whole")
    state = read_checkpoint(whole.checkpoint(HALF))["model"]
    gathered = next(
        values for name, values in state.items() if name.endswith("evidence.sums.values")
    )
    assert len(gathered) > 0, "cut off while evidence is gathered"
    document = json.loads(whole.requirements.read_text())
    assert sum(count > 0 for count in document["rows_by_sh_degree"]) > 1
    assert document["sh_floats"] <= 0.45 * document["sh_floats_full"]


@pytest.mark.slow
def test_files_get_the_missing_bands_as_zeros(tmp_path):
    scene = ("datamanager.width=48", "datamanager.height=36", "datamanager.views=6", "steps=20")
    assert main(["train", "method=3dgs", *scene, *ADAPTIVE, f"out={tmp_path / 'run'}"]) == 0
    found = PlyImporter().read(RunFolder(tmp_path / "run").splats).splats.colors.dense()
    assert found.shape[1:] == (16, 3)
    degrees = degrees_of(found)
    assert int(degrees.min()) == 0
    assert int(degrees.max()) > 0
    assert main(["export", str(tmp_path / "run"), "format=gsfw"]) == 0
    assert main(["render", str(tmp_path / "run" / "model.gsfw")]) == 0


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (StaticGaussiansConfig(bands=BandsConfig(share=0.0)), "bands.share=0: expected a number"),
        (StaticGaussiansConfig(bands=BandsConfig(signal=0.5)), "bands.signal=0.5: expected"),
        (StaticGaussiansConfig(bands=BandsConfig(rate=0.0)), "bands.rate=0: expected a finite"),
        (StaticGaussiansConfig(bands=BandsConfig(every=1)), "bands.every=1: expected a number"),
        (StaticGaussiansConfig(bands=BandsConfig(stop=1)), "bands.stop=1: expected at least"),
        (DeformationConfig(sh="adaptive", deform_sh=True), "the field changes the same bands"),
        (TrackedGaussiansConfig(sh="adaptive"), "tracked Gaussians keep the bands"),
    ],
)
def test_settings_that_cannot_be_are_refused(config, message):
    with pytest.raises(ConfigError, match=message):
        config.check()


def test_bands_that_stop_before_they_grow_are_refused_with_the_setting_to_change():
    with pytest.raises(ConfigError) as caught:
        StaticGaussiansConfig(bands=BandsConfig(stop=1)).check()
    assert caught.value.advice == "Give bands.grow_stop=1 or less, or a larger bands.stop."


def test_a_number_is_short_for_a_degree():
    assert StaticGaussiansConfig(sh="1") == StaticGaussiansConfig(sh_degree=1)
    assert StaticGaussiansConfig(sh="adaptive", sh_degree=2).sh_degree == 2


@pytest.mark.slow
def test_several_views_in_a_step_are_looked_at_one_by_one(tmp_path):
    scene = ("datamanager.width=48", "datamanager.height=36", "datamanager.views=6", "steps=20")
    several = ("sampler.views_per_step=3", f"out={tmp_path}")
    assert main(["train", "method=3dgs", *scene, *ADAPTIVE, *several]) == 0
    rows = json.loads(RunFolder(tmp_path).requirements.read_text())["rows_by_sh_degree"]
    assert sum(rows[1:]) > 0.1 * sum(rows)


@pytest.mark.slow
def test_runs_too_short_for_bands_say_so(capsys):
    dry = ("train", "method=3dgs", "sh=adaptive", "datamanager.width=32", "datamanager.height=24")
    assert main([*dry, "steps=40", "--dry-run"]) == 0
    assert "sh=adaptive: no splat gets a band in this run" in capsys.readouterr().out
    settings = ("steps=3000", "bands.grow_stop=500", "bands.stop=510")
    assert main([*dry, *settings, "--dry-run"]) == 0
    assert "no band is taken away again in this run" in capsys.readouterr().out
