"""The rounding that training sees is that of the file, with the steps of the start."""

from dataclasses import replace

import torch
from support.gaussian_models import COUNT, gaussians
from support.stored_models import some_model

from gsfw.core.column import Layout
from gsfw.formats.compact.rounding import Rounding
from gsfw.formats.model_file import ModelFileExporter, read_model_file


def moved(model):
    """The model as training may leave it: sizes and opacities decide on steps no more."""
    generator = torch.Generator().manual_seed(9)
    state = {
        name: values + 0.3 * torch.randn(values.shape, generator=generator)
        if values.is_floating_point()
        else values
        for name, values in model.state.items()
    }
    return replace(model, state=state)


def written(tmp_path, rounding, trained):
    path = tmp_path / "a.gsfw"
    ModelFileExporter(precision="compressed", step=2.0).write(path, rounding.with_steps(trained))
    return read_model_file(path).state


def test_a_file_holds_the_values_that_were_trained_with(tmp_path):
    motion = torch.randn(COUNT // 2, 3, generator=torch.Generator().manual_seed(1))
    start = gaussians(motion=(Layout.RAGGED, motion))
    start.state["neighbors"] = torch.zeros(COUNT, dtype=torch.int64)  # Keeps the order of rows.
    rounding, trained = Rounding.of(start, 2.0, None), moved(start)
    found = written(tmp_path, rounding, trained)
    for name, column in start.columns.items():
        before = trained.state[column.values]
        assert torch.equal(rounding(name, before), found[column.values]), name
        assert not torch.equal(before, found[column.values]), name


def test_rotations_of_still_models_are_rounded_in_place_and_written_with_length_one(tmp_path):
    start = gaussians()
    rounding, trained = Rounding.of(start, 2.0, None), moved(start)
    found = written(tmp_path, rounding, trained)
    before = trained.state["quats.values"]
    seen, means = rounding("quats", before), rounding("means", trained.state["means.values"])
    assert torch.allclose(seen.norm(dim=1), before.norm(dim=1))
    assert ((seen * before).sum(dim=1) > 0).all()
    rows = torch.cdist(found["means.values"].double(), means.double()).argmin(dim=1)
    assert torch.equal(found["means.values"], means[rows])
    units = seen[rows] / seen[rows].norm(dim=1, keepdim=True)
    cosines = (units * found["quats.values"]).sum(dim=1).abs()
    assert torch.allclose(cosines, torch.ones(COUNT), atol=1e-6)


def test_columns_without_steps_are_not_rounded():
    values = torch.rand(COUNT, 2)
    assert torch.equal(Rounding.of(gaussians(), 2.0, None)("mine", values), values)


def test_models_without_sizes_have_no_rounding():
    assert Rounding.of(some_model(), 1.0, None) is None
