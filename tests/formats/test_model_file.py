"""A model file comes back as it was, and a header that was tampered with is refused by name."""

import copy

import pytest
import torch
from support.states import assert_same_bits
from support.stored_models import some_model

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.formats.array_archive import ArrayArchive, read_archive, write_archive
from gsfw.formats.model_file import ModelFileExporter, read_model_file, read_model_header
from gsfw.formats.model_header import write_header


def plain(value):
    """Dataclasses as dictionaries, so that they can be compared bit by bit."""
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__}
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def test_everything_comes_back_bit_by_bit(tmp_path):
    model, path = some_model(), tmp_path / "a.gsfw"
    ModelFileExporter().write(path, model)
    assert_same_bits(plain(read_model_file(path)), plain(model))


def test_the_header_is_read_without_the_state(tmp_path):
    path = tmp_path / "a.gsfw"
    ModelFileExporter().write(path, some_model())
    model, header = read_model_header(path)
    assert model.rows == 2
    assert model.state == {}
    assert header == write_header(some_model())


@pytest.mark.parametrize(
    ("name", "tensor", "problem"),
    [
        ("a", torch.zeros(2).bfloat16(), r"its a is of type torch.bfloat16"),
        ("a", torch.zeros(2, dtype=torch.complex64), r"its a is of type torch.complex64"),
        ("a", torch.tensor([1.0, float("nan")]), r"a is not finite"),
        ("a/../b", torch.zeros(2), r"'state/a/../b' cannot be the name of an array"),
    ],
)
def test_state_that_it_cannot_hold_is_named_and_nothing_is_written(tmp_path, name, tensor, problem):
    with pytest.raises(ValueError, match=problem):
        ModelFileExporter().write(tmp_path / "a.gsfw", some_model({name: tensor}))
    assert list(tmp_path.iterdir()) == []


def tampered(tmp_path, change=None, drop=()):
    """A file whose header was changed, or that lacks arrays."""
    path = tmp_path / "a.gsfw"
    ModelFileExporter().write(path, some_model())
    archive = read_archive(path)
    header = copy.deepcopy(dict(archive.header))
    if change is not None:
        change(header)
    arrays = {name: array for name, array in archive.arrays.items() if name not in drop}
    write_archive(path, ArrayArchive(header, arrays))
    return path


def refusal(path):
    with pytest.raises(DataError) as caught:
        read_model_file(path)
    return caught.value.message.removeprefix(f"{path}: ")


def at(header, place, value):
    *outer, last = place.split(".")
    for key in outer:
        header = header[int(key) if key.isdigit() else key]
    header[last] = value


def test_cameras_of_version_0_1_0_had_two_more_entries(tmp_path):
    def change(header):
        for camera in header["cameras"]:
            camera |= {"distortion": None, "image_index": 4}

    views = read_model_file(tampered(tmp_path, change)).views[Split.TRAIN]
    assert views.names == some_model().views[Split.TRAIN].names


@pytest.mark.parametrize(
    ("place", "value", "problem"),
    [
        ("rows", -1, "rows of its header: expected a whole number of at least 0, found -1."),
        ("rows", True, "rows of its header: expected a whole number of at least 0, found True."),
        ("rows", 10**400, "rows of its header: expected a whole number of at least 0, found 1000"),
        ("step", 1.5, "step of its header: expected a whole number of at least 0, found 1.5."),
        ("method", "mine", "method of its header: expected an object, found 'mine'."),
        ("method.name", 3, "method.name of its header: expected text, found 3."),
        ("scene.extent", 0, "scene.extent of its header: expected a number above 0, found 0."),
        ("scene.extent", 10**400, "scene.extent of its header: expected a number above 0, found 1"),
        ("scene.has_alpha", 1, "scene.has_alpha of its header: expected true or false, found 1."),
        ("scene.time_range", [1], "scene.time_range of its header: expected 2 finite numbers, fou"),
        (
            "scene.world_from_scene.rotation", [[1, 0], [0, 1]],
            "scene.world_from_scene.rotation of its header: expected 3 x 3 finite numbers, found",
        ),
        ("render.profile", "x", "render.profile of its header: expected default, gsplat-1.5, foun"),
        ("render.background", ["1", 1, 1], "render.background[0] of its header: expected one fini"),
        ("cameras", {}, "cameras of its header: expected a list of objects, found {}."),
        ("cameras", [], "its header has no cameras that it was trained on."),
        ("cameras.0.width", 0, "cameras[0].width of its header: expected a whole number of at le"),
        ("cameras.0.model", "box", "cameras[0] has the model 'box'."),
        ("cameras.1.split", "test", "cameras[1] is of the split 'test'."),
        ("cameras.1.time", "now", "cameras[1].time of its header: expected one finite number, f"),
        ("columns.means.layout", "loose", "column means has the layout 'loose'."),
        ("columns.means.values", "state/no", "it has no state/no, of column means."),
        ("settings.size", {"a": 1}, "setting size is a nested value."),
        ("settings.size", [[1]], "setting size is a nested value."),
    ],
)  # fmt: skip
def test_a_header_that_was_tampered_with_is_refused_by_name(tmp_path, place, value, problem):
    path = tampered(tmp_path, lambda header: at(header, place, value))
    assert refusal(path).startswith(problem)


def test_an_up_direction_that_names_no_axis_is_unknown(tmp_path):
    path = tampered(tmp_path, lambda header: at(header, "scene.up", "y\nelement vertex 7"))
    assert read_model_file(path).scene.up == ""


@pytest.mark.parametrize("key", list(write_header(some_model())))
def test_a_field_that_is_missing_is_named(tmp_path, key):
    path = tampered(tmp_path, lambda header: header.pop(key))
    if key == "gsfw":  # Which is only read to say who wrote a file that is newer.
        read_model_file(path)
    elif key == "format":
        assert refusal(path).endswith("is no model file: expected format 'gsfw model', found None.")
    else:
        assert refusal(path).startswith(f"{key} of its header is missing; expected ")


def test_an_array_that_is_missing_is_named(tmp_path):
    path = tampered(tmp_path, drop=("state/motion.offsets",))
    assert refusal(path) == "it has no state/motion.offsets, of column motion."


def test_values_that_are_not_finite_are_refused(tmp_path):
    path = tampered(tmp_path)
    archive = read_archive(path)
    broken = archive.arrays["state/half"].copy()
    broken[2] = float("inf")
    write_archive(path, ArrayArchive(archive.header, {**archive.arrays, "state/half": broken}))
    assert refusal(path) == "state/half holds values that are not finite."
