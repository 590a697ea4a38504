"""Random scenes are the same each time, and as dense however many splats they have."""

import pytest
import torch

from gsfw.core.errors import ConfigError
from gsfw.core.render_settings import RenderSettings
from gsfw.studies.bench.pairs import contributing_pairs
from gsfw.studies.bench.scene import built_in, random_workload, scattered

CPU = torch.device("cpu")


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
