"""Runs that do not fit into memory are refused in words before they begin."""

from dataclasses import replace

import pytest
import torch
from support.small_scene import SMALL_SCENE
from support.street import write_street

from gsfw.core import machine_memory
from gsfw.core.errors import NotEnoughMemoryError
from gsfw.core.machine_memory import Limit, MachineMemory
from gsfw.core.training_memory import START_BYTES, USUAL_ROW
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod
from gsfw.planning.costs import memory_note
from gsfw.plugins.compose import compose
from gsfw.plugins.memory_fit import MemoryFit, usual_cache_mb
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, Settings, resolve

MB = 10**6
CPU = torch.device("cpu")


@pytest.fixture
def memory(monkeypatch):
    """Sets the memory that there is, in megabytes."""

    def there_is(megabytes: float, **more: object) -> None:
        found = MachineMemory(int(megabytes * MB), int(megabytes * MB), **more)
        monkeypatch.setattr(machine_memory, "machine_memory", lambda: found)

    return there_is


def settings(*words: str) -> Settings:
    given = dict(word.split("=", 1) for word in ("method=3dgs", "device=cpu", *words))
    return resolve(installed(), [Layer(COMMAND_LINE, given)])


def composed(*words: str, **more: object):
    return compose(settings(*SMALL_SCENE, *words), installed(), **more)


def refusal(*words: str) -> NotEnoughMemoryError:
    with pytest.raises(NotEnoughMemoryError) as caught:
        compose(settings(*words), installed())
    return caught.value


@pytest.fixture(scope="module")
def street(tmp_path_factory) -> str:
    """A data set of 300,000 points."""
    folder = tmp_path_factory.mktemp("large") / "street"
    return str(write_street(folder, views=4, points=300_000))


def test_a_start_that_does_not_fit_is_refused_with_what_needs_less(street, memory):
    memory(540, limit=Limit.GROUP)
    error = refusal(f"data={street}")
    assert error.exit_code == 2
    assert error.message == (
        "training needs about 716 MB of memory for 300,000 Gaussians to start with, and the "
        "control group of this process allows 540 MB."
    )
    assert error.advice == (
        "A run needs less with fewer Gaussians to start with (init=dense dense_points=170000) or "
        "fewer numbers of colour (sh_degree=1).\n"
        f"gsfw partition {street} out=DIR memory=540MB cuts the scene into blocks that fit; "
        "processes=N shards=N shares the Gaussians of one model among machines.\n"
        "check_memory=false trains all the same."
    )


@pytest.mark.slow
def test_what_is_proposed_fits_and_the_need_is_known_before_a_large_model_is_built(
    street, memory, monkeypatch
):
    built, build = [], StaticGaussiansMethod.build_model

    def counting(self, scene, *arguments):
        built.append(len(scene.points))
        return build(self, scene, *arguments)

    monkeypatch.setattr(StaticGaussiansMethod, "build_model", counting)
    data = f"data={street}"
    memory(540)
    assert "this machine has 540 MB." in refusal(data).message
    compose(settings(data, "sh_degree=1"), installed())
    assert built == [500, 500, 300_000]
    found = settings(data)
    assert MemoryFit(found, open_data(found), CPU).need(170_000, USUAL_ROW).total < 540 * MB


def test_large_images_are_named_with_settings_that_shrink_them(memory):
    memory(290)
    advice = refusal(*SMALL_SCENE, "datamanager.width=1600", "datamanager.height=1200").advice
    assert advice == (
        "A run needs less with smaller images (downscale=2).\n"
        "check_memory=false trains all the same."
    )


def test_many_images_are_named_with_a_smaller_cache(memory):
    memory(220)
    words = ("datamanager.views=400", "datamanager.width=200", "datamanager.height=200")
    error = refusal(*SMALL_SCENE, *words, "cache_mb=200")
    assert "fewer decoded images (cache_mb=16) or smaller images (downscale=2)" in error.advice


def test_a_run_that_may_fit_is_not_refused(memory):
    memory(270)  # About 350 MB are estimated.
    composed()


def test_swap_keeps_a_run_alive(memory):
    memory(200, swap=100 * MB)
    composed()


def test_who_insists_trains_all_the_same(memory):
    memory(100)
    composed("check_memory=false")


def test_a_trained_model_is_opened_whatever_training_would_need(memory):
    memory(100)
    assert len(composed(restoring=True).parts.table) == 150


def test_unknown_memory_refuses_nothing(monkeypatch):
    monkeypatch.setattr(machine_memory, "machine_memory", lambda: None)
    composition = composed()
    assert memory_note(composition) == ()
    assert usual_cache_mb(composition.settings) == 2048


def test_processes_of_one_machine_share_its_memory(memory, monkeypatch):
    memory(540)
    composed()
    monkeypatch.setenv("LOCAL_WORLD_SIZE", "3")
    assert "this machine has 540 MB, of which 180 MB are left" in refusal(*SMALL_SCENE).message


def fit_of(*words: str, device: str = "cpu") -> MemoryFit:
    found = settings(*SMALL_SCENE, *words)
    return MemoryFit(found, open_data(found), torch.device(device))


def test_shards_are_in_a_process_each_that_makes_all_gaussians_at_the_start():
    assert fit_of("processes=2", "shards=4").need(1001, USUAL_ROW).row.kept == USUAL_ROW.kept / 2
    assert fit_of("processes=4", "shards=4").need(1001, USUAL_ROW).row.peak == START_BYTES
    assert fit_of("processes=4").need(1001, USUAL_ROW).gaussians == 1001


@pytest.fixture
def gpu(monkeypatch):
    """A GPU of 1 GB, of which other programs have 300 MB, and torch keeps 100 MB that are free."""
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda device: (600 * MB, 1000 * MB))
    monkeypatch.setattr(torch.cuda, "memory_reserved", lambda device: 100 * MB)
    monkeypatch.setattr(torch.cuda, "memory_allocated", lambda device: 0)
    return torch.device("cuda")


def test_gaussians_on_a_gpu_take_its_memory_and_no_main_memory(gpu):
    fit = fit_of(device="cuda")
    assert fit.need(10**9, USUAL_ROW).total < 400 * MB
    assert fit.most_gaussians(USUAL_ROW) == 510_000
    assert fit.rows_need(1000, USUAL_ROW) == 1000 * USUAL_ROW.peak
    shared = fit_of("processes=4", "shards=4", device="cuda")
    assert shared.rows_need(1000, USUAL_ROW) < fit.rows_need(1000, USUAL_ROW)


def test_gaussians_that_no_gpu_memory_holds_are_refused_before_they_are_made(gpu):
    class Counted:
        """A scene of as many points, of which a model of a few is built."""

        def __init__(self, points: int) -> None:
            self.scene, self.built = replace(fit.data.scene, points=torch.rand(points, 3)), []
            self.scene = replace(self.scene, point_colors=self.scene.points)

        def build_model(self, scene, operators, generator, initial):
            self.built.append(len(scene.points))
            method = settings(*SMALL_SCENE).config.build()
            return method.build_model(scene, operators, generator, initial)

    fit = fit_of(device="cuda")
    fits, large = Counted(700_000), Counted(800_000)
    fit.check_start(fits, fits.scene, None)
    with pytest.raises(NotEnoughMemoryError) as caught:
        fit.check_start(large, large.scene, None)
    assert fits.built == large.built == [500]
    assert caught.value.message == (
        "training needs 755 MB of GPU memory and more for 800,000 Gaussians to start with, and "
        "its GPU has 1.0 GB, of which 700 MB are left."
    )
    assert "init=dense dense_points=510000" in caught.value.advice
    fit_of("check_memory=false", device="cuda").check_start(large, large.scene, None)


def test_growth_beyond_the_memory_of_a_gpu_is_noted(gpu):
    free = ("datamanager.width=800", "datamanager.height=600", "strategy.max_gaussians=3000000")
    made = composed(*free, "datamanager.points=20000", "steps=30000")
    there = replace(made, parts=replace(made.parts, device=gpu))
    (note,) = memory_note(there)
    assert "its GPU has 1.0 GB, of which 700 MB are left; about 510,000 fit" in note


def test_growth_beyond_memory_is_noted_with_the_limit_that_prevents_it(memory):
    memory(8000)
    free = ("datamanager.width=400", "datamanager.height=300", "strategy.max_gaussians=3000000")
    long = (*free, "datamanager.points=20000", "steps=30000")
    assert memory_note(composed(*long)) == ()
    memory(600)
    assert memory_note(composed(*long)) == (
        "memory may run short: the 240,000 Gaussians that the model may grow to need about 624 MB, "
        "and this machine has 600 MB; about 220,000 fit (strategy.max_gaussians=220000 ends growth "
        "there).",
    )
    assert memory_note(composed(*long, "strategy.max_gaussians=90000")) == ()


def test_a_start_that_hardly_fits_is_noted(memory):
    memory(400)
    start = ("datamanager.points=90000", "strategy=none")
    assert memory_note(composed(*start)) == (
        "memory may run short: the 90,000 Gaussians need about 419 MB, and this machine has "
        "400 MB; about 75,000 fit.",
    )


def test_the_usual_cache_takes_a_quarter_of_the_memory_and_what_is_given_stays(memory):
    memory(1292)
    assert usual_cache_mb(settings(*SMALL_SCENE)) == 250
    assert usual_cache_mb(settings(*SMALL_SCENE, "cache_mb=2048")) == 2048
    memory(100)
    assert usual_cache_mb(settings(*SMALL_SCENE)) == 100
    memory(64_000)
    assert usual_cache_mb(settings(*SMALL_SCENE)) == 2048


def test_images_that_do_not_stay_in_memory_are_noted(memory):
    words = ("datamanager.views=198", "datamanager.width=500", "datamanager.height=400")
    ample = settings(*SMALL_SCENE, *words, "cache_mb=2048")
    data = open_data(ample)
    memory(800)
    assert MemoryFit(settings(*SMALL_SCENE, *words), data, CPU).notes() == (
        "decoded images take at most 127 MB of 160, as this machine has 800 MB (cache_mb=N sets "
        "another number).",
    )
    assert MemoryFit(ample, data, CPU).notes() == ()
    memory(4000)
    assert MemoryFit(settings(*SMALL_SCENE, *words), data, CPU).notes() == ()
