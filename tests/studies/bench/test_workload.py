"""A workload is random, or comes from an npz file; a file that is none is one clear message."""

import numpy as np
import pytest
import torch

from gsfw.core.errors import ConfigError, DataError
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh
from gsfw.studies.bench.pairs import contributing_pairs
from gsfw.studies.bench.workload import (
    ADVICE,
    built_in,
    random_workload,
    read_workload,
    scattered,
)

CPU = torch.device("cpu")

FIELDS = {
    "means": np.zeros((5, 3)),
    "quats": np.ones((5, 4)),
    "scales": np.full((5, 3), 0.1),
    "opacities": np.full(5, 0.5),
    "colors": np.zeros((5, 3)),
    "world_to_camera": np.eye(4),
    "intrinsics": np.array([[30.0, 0, 16], [0, 30, 12], [0, 0, 1]]),
    "width": 32,
    "height": 24,
}

NO_ARCHIVE = (
    "workload=FILE: this is not an npz file that can be read: "
    "it is no zip archive of arrays, or was cut off."
)


def write(path, **changes):
    """A workload file with some fields changed; None leaves one out."""
    fields = {name: value for name, value in (FIELDS | changes).items() if value is not None}
    np.savez(path / "workload.npz", **fields)
    return path / "workload.npz"


def refusal(path) -> str:
    with pytest.raises(DataError) as refused:
        read_workload(path)
    assert refused.value.advice == ADVICE
    assert str(path) in refused.value.message
    return refused.value.message.replace(str(path), "FILE")


def test_a_file_of_any_precision_becomes_float32(tmp_path):
    workload = read_workload(write(tmp_path))
    assert workload.description == "5 splats, RGB, one camera of 32x24"
    assert all(tensor.dtype == torch.float32 for tensor in workload.splats.tensors().values())
    assert workload.cameras.world_to_camera.shape == (1, 4, 4)
    assert (workload.cameras.width, workload.cameras.height) == (32, 24)


def test_one_set_of_intrinsics_holds_for_all_cameras(tmp_path):
    workload = read_workload(
        write(tmp_path, world_to_camera=np.stack([np.eye(4)] * 3), colors=np.zeros((5, 16, 3)))
    )
    assert workload.cameras.intrinsics.shape == (3, 3, 3)
    assert isinstance(workload.splats.colors, Sh)
    assert workload.splats.colors.degree == 3


def test_a_file_that_is_absent_is_named(tmp_path):
    assert refusal(tmp_path / "gone.npz") == "workload=FILE: there is no such file."


def test_a_folder_is_no_file(tmp_path):
    assert refusal(tmp_path) == "workload=FILE: there is no such file."


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04 cut off"])
def test_what_is_no_npz_file_is_refused(tmp_path, content):
    path = tmp_path / "workload.npz"
    path.write_bytes(content)
    assert refusal(path) == NO_ARCHIVE


def test_a_truncated_file_is_refused(tmp_path):
    path = write(tmp_path)
    path.write_bytes(path.read_bytes()[:700])
    assert refusal(path) == NO_ARCHIVE


def test_a_file_with_damaged_bytes_is_refused(tmp_path):
    path = write(tmp_path)
    content = bytearray(path.read_bytes())
    content[200:220] = b"\xff" * 20
    path.write_bytes(content)
    assert refusal(path).startswith("workload=FILE: this is not an npz file that can be read: ")


@pytest.mark.slow
def test_a_single_array_is_refused(tmp_path):
    np.save(tmp_path / "array.npy", np.zeros(3))
    assert refusal(tmp_path / "array.npy") == NO_ARCHIVE


def test_pickled_objects_are_not_run(tmp_path):
    path = write(tmp_path, means=np.array([{}], dtype=object))
    assert "it holds Python objects, not numbers" in refusal(path)


def test_a_missing_field_is_named_beside_what_is_there(tmp_path):
    assert refusal(write(tmp_path, scales=None)) == (
        "workload=FILE: scales is missing; the file holds means, quats, opacities, colors, "
        "world_to_camera, intrinsics, width, height."
    )


def test_a_field_without_numbers_is_named(tmp_path):
    path = write(tmp_path, width="wide")
    assert refusal(path) == "workload=FILE: width: expected numbers, found <U4."


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("quats", np.ones((5, 3)), "quats: expected shape [5, 4], found [5, 3]."),
        ("opacities", np.ones(4), "opacities: expected shape [5], found [4]."),
        ("means", np.zeros((0, 3)), "means: expected shape [1, 3], found [0, 3]."),
        ("means", np.float32(1), "means: expected shape [1, 3], found []."),
        ("colors", np.zeros((5, 7, 3)), "colors: expected shape [5, 3] or [5, 1, 3] or [5, 4, 3]"),
        ("world_to_camera", np.eye(3), "world_to_camera: expected shape [4, 4], found [3, 3]."),
        ("intrinsics", np.zeros((2, 3, 3)), "intrinsics: expected shape [3, 3] or [1, 3, 3]"),
        ("height", np.ones(2), "height: expected shape [] or [1], found [2]."),
        ("width", 0, "width: expected a whole number from 1 to 32768, found 0."),
        ("width", 3.5, "width: expected a whole number from 1 to 32768, found 3.5."),
        ("height", np.nan, "height: expected a whole number from 1 to 32768, found nan."),
        ("opacities", np.full(5, 1.5), "splats.opacities: expected values in [0, 1]; 5 of 5 rows"),
        ("scales", np.full((5, 3), -1.0), "splats.scales: expected scales >= 0; 5 of 5 rows"),
        ("means", np.full((5, 3), 1e300), "splats.means: expected finite values; 5 of 5 rows"),
        ("intrinsics", np.zeros((3, 3)), "cameras.intrinsics: expected focal lengths > 0; 1 of 1"),
    ],
)
def test_a_wrong_shape_or_value_is_named(tmp_path, field, value, said):
    assert refusal(write(tmp_path, **{field: value})).startswith(f"workload=FILE: {said}")


def test_what_is_not_a_number_is_found(tmp_path):
    means = np.zeros((5, 3))
    means[3, 1] = np.nan
    assert "1 of 5 rows are not, the first is row 3" in refusal(write(tmp_path, means=means))


def test_copies_lie_side_by_side_around_the_one_that_is_seen(tmp_path):
    means = np.zeros((5, 3))
    means[0], means[1] = (-1.0, -2.0, 3.0), (1.0, 2.0, -3.0)
    workload = read_workload(write(tmp_path, means=means))
    copied = workload.copied(3)
    assert copied.name.endswith(", 3x3 copies")
    assert copied.description == "45 splats, RGB, one camera of 32x24"
    blocks = copied.splats.means.view(9, 5, 3)
    shifts = blocks[:, 0] - workload.splats.means[0]
    places = [(x, y) for x in (-2.0, 0.0, 2.0) for y in (-4.0, 0.0, 4.0)]
    assert torch.equal(shifts, torch.tensor([(x, y, 0.0) for x, y in places]))
    assert torch.equal(blocks[4], workload.splats.means)
    assert torch.equal(copied.splats.opacities, workload.splats.opacities.repeat(9))
    assert workload.copied(1) is workload


def test_another_size_stretches_the_image(tmp_path):
    workload = read_workload(write(tmp_path)).sized(64, 12)
    assert workload.description.endswith("one camera of 64x12")
    expected = torch.tensor([[60.0, 0.0, 32.0], [0.0, 15.0, 6.0], [0.0, 0.0, 1.0]])
    assert torch.equal(workload.cameras.intrinsics[0], expected)


def test_a_workload_moves_between_devices(tmp_path):
    moved = read_workload(write(tmp_path)).to(torch.device("meta"))
    tensors = [*moved.splats.tensors().values(), moved.cameras.intrinsics]
    assert {tensor.device.type for tensor in tensors} == {"meta"}


def test_the_built_in_workload_is_the_same_each_time():
    first, second = built_in(CPU), built_in(CPU)
    assert first.description == "100,000 splats, RGB, one camera of 640x420"
    for name, tensor in first.splats.tensors().items():
        assert torch.equal(tensor, second.splats.tensors()[name])


def test_another_seed_is_another_scene():
    one, _ = scattered(10, 32, 24, CPU, seed=1)
    two, _ = scattered(10, 32, 24, CPU, seed=2)
    assert not torch.equal(one.means, two.means)


@pytest.mark.parametrize(
    ("count", "width", "height"), [(1000, 96, 54), (4000, 96, 54), (1000, 48, 27)]
)
def test_about_50_splats_contribute_to_each_pixel(count, width, height):
    splats, cameras = scattered(count, width, height, CPU)
    pairs = contributing_pairs(splats, cameras, RenderSettings())
    assert 35 < pairs / (width * height) < 65


def test_a_number_of_splats_is_drawn_at_1080p():
    workload = random_workload("random:12", CPU)
    assert workload.description == "12 splats, RGB, one camera of 1920x1080"


@pytest.mark.parametrize("given", ["", "0", "many", "-3", "1e6"])
def test_what_is_no_number_of_splats_is_refused(given):
    with pytest.raises(ConfigError) as refused:
        random_workload(f"random:{given}", CPU)
    assert refused.value.message == (
        f"workload=random:{given}: expected a number of splats after random:, found {given!r}."
    )
    assert refused.value.advice == "Write it in digits: workload=random:1000000"
