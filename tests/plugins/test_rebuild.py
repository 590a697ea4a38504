"""A stored model is rebuilt without its data set, and is the same at all times to the last bit."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from support.moving_scene import DriftingPlugin
from support.states import assert_same_bits

from gsfw.core.column import Layout
from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.core.loop.evaluation import render_model
from gsfw.core.loop.run_folder import RunFolder
from gsfw.formats.model_file import ModelFileExporter, read_model_file
from gsfw.plugins.compose import compose
from gsfw.plugins.discovery import PluginSource
from gsfw.plugins.rebuild import rebuild, stored_model
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import Restored
from gsfw.plugins.run_source import RunSource
from gsfw.plugins.settings import Layer, resolve
from gsfw.plugins.specs import PROJECT

SMALL = {
    "datamanager.views": 6, "datamanager.eval_views": 2, "datamanager.width": 32,
    "datamanager.height": 24, "datamanager.points": 150, "datamanager.moving": True,
    "datamanager.times": 3, "steps": 60,
}  # fmt: skip
TINY_HASH = {"hash.levels": 2, "hash.finest": 16, "hash.log2_rows": 8}
STILL = {"static": "auto"}

MODELS = {
    "3dgs": {"method": "3dgs", "ignore_time": True},
    "3dgs without bands": {"method": "3dgs", "ignore_time": True, "sh_degree": 0},
    "3dgs with bands of its own": {"method": "3dgs", "ignore_time": True, "sh": "adaptive"},
    "spacetime": {"method": "spacetime"},
    "spacetime with features": {"method": "spacetime", "colors": "features"},
    "spacetime freetime": {"method": "spacetime", "preset": "freetime"},
    "4d-rotor": {"method": "4d-rotor", "rotation": "rotor"},
    "4d-rotor two": {"method": "4d-rotor", "rotation": "two-quaternions"},
    "4dgs hexplane": {"method": "4dgs", "hexplane.resolution": 8, "deform_opacity": True},
    "4dgs mlp": {"method": "4dgs", "encoder": "mlp", "mlp.width": 16, "deform_sh": True},
    "4dgs hash": {"method": "4dgs", "encoder": "hash", **TINY_HASH},
    "4dgs with rows that stand still": {"method": "4dgs", "encoder": "hash", **TINY_HASH, **STILL},
    "spacetime with rows that stand still": {"method": "spacetime", **STILL},
    "dynamic3dgs": {"method": "dynamic3dgs"},
}


def composed(settings):
    """A run before its first step."""
    registry = installed()
    layer = Layer("tests", {key: str(value) for key, value in {**SMALL, **settings}.items()})
    return compose(resolve(registry, [layer]), registry)


@torch.no_grad()
def trained(settings, folder):
    """A run whose model has other numbers and rows than it began with, as training leaves it."""
    composition = composed(settings)
    model, generator = composition.parts.model, torch.Generator().manual_seed(1)
    if settings["method"] == "dynamic3dgs":
        for step, time in enumerate((0.0, 0.5, 1.0)):
            composition.parts.method.prepare(step, model, composition.parts.optimizer, time)
        model.canonical.active_degree = model.canonical.degree  # As restored runs have it.
    table = composition.parts.table
    table.keep(torch.arange(0, model.num_rows, 2))
    for name, column in model.columns().items():
        if column.layout is Layout.RAGGED:  # Every third row has values where it had none.
            lengths, some = column.offsets.diff(), 3 if name == "sh_rest" else 1
            lengths[::3] = some - lengths[::3]
            table.resize(name, lengths)
    for tensor in (*model.parameters(), *(c.values for c in model.columns().values())):
        if tensor.is_floating_point():
            tensor.add_(0.05 * torch.randn(tensor.shape, generator=generator))
    model.project_()
    return Restored(RunFolder(folder), composition, {"step": 7})


def reloaded(restored, path, changed=None):
    """The run through a file."""
    ModelFileExporter().write(path, stored_model(restored))
    return rebuild(read_model_file(path), path, installed(), changed)


def psnr(first, second):
    return float(-10 * (first - second).square().mean().log10())


def image(run):
    """What a held-out camera sees, decoded."""
    parts, settings = run.composition.parts, run.composition.plan.settings
    camera = parts.data.views(Split.EVAL).cameras[1]
    return render_model(parts.model, parts.rasterizer, camera, settings, camera.time[0]).color


def bits(splats):
    colors = splats.colors
    return {**splats.tensors(), "rows": splats.rows, "degree": getattr(colors, "degree", None)}


def test_every_registered_method_is_tested():
    specs = installed().slot("method").values()
    own = {spec.name for spec in specs if spec.distribution == PROJECT}
    assert {settings["method"] for settings in MODELS.values()} >= own


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_smaller_files_look_nearly_the_same(name, tmp_path):
    run = trained(MODELS[name], tmp_path)
    whole, path = image(run), tmp_path / "model.gsfw"
    sizes = []
    for options, least in (
        ({"precision": "float16"}, 55),
        ({"precision": "compressed", "step": 0.1}, 45),
        ({"precision": "compressed"}, 30),
    ):
        ModelFileExporter(**options).write(path, RunSource(run))
        again = rebuild(read_model_file(path), path, installed())
        assert psnr(image(again), whole) > least, options
        sizes.append(path.stat().st_size)
    assert sizes[2] < sizes[0]


@pytest.mark.parametrize("name", MODELS)
def test_a_rebuilt_model_is_the_same_to_the_last_bit_at_all_times(name, tmp_path):
    run = trained(MODELS[name], tmp_path)
    again = reloaded(run, tmp_path / "model.gsfw")
    images = [image(run), image(again)]
    assert torch.equal(*images)
    assert float(images[0].std()) > 0.01
    model, other = run.composition.parts.model, again.composition.parts.model
    assert again.step == 7
    assert_same_bits(dict(model.state_dict()), dict(other.state_dict()))
    for time in (None, 0.0, 0.123, 0.5, 1.0):
        instant = None if time is None else torch.tensor(time)
        assert_same_bits(bits(model.splats(instant)), bits(other.splats(instant)))


def test_scene_cameras_and_settings_come_back(tmp_path):
    run = trained(MODELS["spacetime"], tmp_path)
    again = reloaded(run, tmp_path / "model.gsfw")
    before, after = run.composition, again.composition
    frames = before.scene.world_from_scene, after.scene.world_from_scene
    assert_same_bits(*({**vars(frame)} for frame in frames))
    facts = ("name", "extent", "time_range", "num_times", "has_alpha", "up")
    assert [getattr(before.scene, f) for f in facts] == [getattr(after.scene, f) for f in facts]
    for split in Split:
        views, same = before.parts.data.views(split), after.parts.data.views(split)
        assert views.names == same.names
        assert views.origin == same.origin
        for camera, other in zip(views.cameras, same.cameras, strict=True):
            assert_same_bits({**vars(camera)}, {**vars(other)})
    assert_same_bits({**vars(before.plan.settings)}, {**vars(after.plan.settings)})
    changed = {
        key: (value, after.settings.flat()[key])
        for key, value in before.settings.flat().items()
        if after.settings.flat().get(key) != value
    }
    assert {key.partition(".")[0] for key in changed} <= {"datamanager", "strategy", "init"}


def test_columns_say_where_they_lie(tmp_path):
    stored = stored_model(trained(MODELS["spacetime"], tmp_path))
    assert stored.columns["motion"].values == "temporal.motion.values"
    assert stored.columns["means"].layout is Layout.DENSE
    assert all(
        len(stored.state[column.values]) == stored.rows for column in stored.columns.values()
    )


@pytest.fixture
def drifting():
    """A method of another package."""
    discovery = installed()._discovery
    discovery.add(DriftingPlugin(), PluginSource("drifting", "drifting-plugin", "1.5"))
    yield
    discovery.remove("drifting")


def test_a_method_of_a_third_party_comes_back_by_the_same_path(drifting, tmp_path):
    run = trained({"method": "drifting"}, tmp_path)
    again = reloaded(run, tmp_path / "model.gsfw")
    for time in (torch.tensor(0.0), torch.tensor(0.7)):
        models = (run.composition.parts.model, again.composition.parts.model)
        assert_same_bits(*(bits(model.splats(time)) for model in models))


def test_a_method_that_is_not_installed_is_named_with_its_package(drifting, tmp_path):
    path = tmp_path / "model.gsfw"
    ModelFileExporter().write(path, stored_model(trained({"method": "drifting"}, tmp_path)))
    installed()._discovery.remove("drifting")
    with pytest.raises(DataError) as caught:
        rebuild(read_model_file(path), path, installed())
    assert caught.value.message == (
        f"{path} cannot be opened: no method 'drifting' is installed here. The run was made with "
        "drifting-plugin 1.5."
    )
    assert caught.value.advice == ("Install it, if you trust it: pip install drifting-plugin==1.5")


def test_the_data_set_may_be_given_and_has_to_be_that_of_the_model(tmp_path):
    run = trained(MODELS["spacetime"], tmp_path)
    ModelFileExporter().write(tmp_path / "model.gsfw", stored_model(run))
    stored = read_model_file(tmp_path / "model.gsfw")
    changed = Layer("tests", {"data": ""})
    again = rebuild(stored, tmp_path / "model.gsfw", installed(), changed)
    assert again.composition.parts.data.has_images
    frame = replace(stored.scene.world_from_scene, scale=1.1)
    elsewhere = replace(stored, scene=replace(stored.scene, world_from_scene=frame))
    with pytest.raises(DataError, match="was not trained on data=: places in it lie"):
        rebuild(elsewhere, tmp_path / "model.gsfw", installed(), changed)


def refusal(stored):
    with pytest.raises(DataError) as caught:
        rebuild(stored, Path("m.gsfw"), installed())
    return caught.value.message.removeprefix("m.gsfw cannot be drawn: ")


def test_a_state_that_does_not_fit_the_method_is_named(tmp_path):
    stored = stored_model(trained(MODELS["spacetime"], tmp_path))
    state = dict(stored.state)

    def with_state(**tensors):
        names = {name.replace("__", "."): tensor for name, tensor in tensors.items()}
        return replace(stored, state={**state, **names})

    without = {name: value for name, value in state.items() if name != "canonical.means.values"}
    assert refusal(replace(stored, state=without)) == (
        "it has no state canonical.means.values, which method 'spacetime' needs."
    )
    assert refusal(with_state(more=torch.zeros(1))) == (
        "method 'spacetime' does not know its state more."
    )
    assert refusal(with_state(canonical__means__values=torch.zeros(75, 4))) == (
        "its canonical.means.values is float32 of shape (75, 4); the model of method 'spacetime' "
        "has float32 of shape (64, 3)."
    )
    assert refusal(with_state(canonical__means__values=torch.zeros(75, 3).double())).startswith(
        "its canonical.means.values is float64 of shape (75, 3);"
    )
    assert refusal(with_state(canonical__means__values=torch.zeros(74, 3))) == (
        "column means has 74 rows, and the model 75."
    )
    assert refusal(replace(stored, rows=76)) == "column means has 75 rows, and the model 76."
    settings = {**stored.settings, "motion_order": 2}
    assert refusal(replace(stored, settings=settings)).startswith(
        "its temporal.motion.values is float32 of shape (75, 3, 3); the model of method"
    )
