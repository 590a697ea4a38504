"""Model files in half precision and compressed: what changes, by how much, and what is refused."""

import json
import lzma
import zipfile
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from support.gaussian_models import COUNT, gaussians, moving
from support.states import assert_same_bits
from support.stored_models import some_model

from gsfw.core.column import Layout
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.exchange import ExportSource, StoredModel
from gsfw.formats.array_archive import ArrayArchive, read_archive, write_archive
from gsfw.formats.compact.steps import RULES
from gsfw.formats.description import describe_model
from gsfw.formats.model_file import ModelFileExporter, read_model_file


def trip(tmp_path, model, **options):
    path = tmp_path / "a.gsfw"
    ModelFileExporter(**options).write(path, model)
    return path, read_model_file(path)


def test_half_files_round_to_half_what_can_be(tmp_path):
    model = moving()
    path, found = trip(tmp_path, model, precision="float16")
    for name, tensor in model.state.items():
        half = tensor.half().float()
        kept = tensor.dtype != torch.float32 or name == "huge.values"
        assert_same_bits(found.state[name], tensor if kept else half)
    assert found.columns == model.columns
    assert np.load(path)["state/quats.values"].dtype == np.float16


def test_positions_that_half_precision_would_move_stay_whole(tmp_path):
    model = gaussians()
    assert not torch.equal(
        trip(tmp_path, model, precision="float16")[1].state["means.values"],
        model.state["means.values"],
    )
    model.state["log_scales.values"] -= 5
    found = trip(tmp_path, model, precision="float16")[1].state["means.values"]
    assert torch.equal(found, model.state["means.values"])


def test_few_and_tiny_values_beside_the_columns_stay_whole(tmp_path):
    model = gaussians()
    model.state["times"] = torch.rand(100)
    model.state["tiny"] = 1e-6 * torch.rand(2000)
    model.state["grid"] = torch.rand(2000)
    found = trip(tmp_path, model, precision="float16")[1].state
    for name in ("times", "tiny"):
        assert torch.equal(found[name], model.state[name])
    assert torch.equal(found["grid"], model.state["grid"].half().float())


def matched(model, found, name):
    """A column as it was, in the order of the rows that were read, which are sorted."""
    before, after = (m.state["means.values"].double() for m in (model, found))
    rows = torch.cdist(after, before).argmin(dim=1)
    assert len(rows.unique()) == COUNT
    column = model.columns[name]
    values = model.state[column.values]
    if column.layout is Layout.STACKED:
        return values[:, rows]
    if column.layout is Layout.RAGGED:
        place = model.state[column.offsets][:-1]
        return values[torch.cat([place[rows[rows % 2 == 1]]])]
    return values[rows]


@pytest.mark.parametrize("step", [0.25, 1.0])
def test_compressed_files_keep_every_column_within_its_steps(tmp_path, step):
    model = moving()
    path, found = trip(tmp_path, model, precision="compressed", step=step)
    assert {name: t.shape for name, t in found.state.items()} == {
        name: t.shape for name, t in model.state.items()
    }
    lost = {
        name: (found.state[f"{name}.values"].double() - matched(model, found, name).double()).abs()
        for name in model.columns
    }
    # Steps between 1/16 and 16 times the rule's; the opacity and the proxy keep most near 1.
    for name in ("log_scales", "quats", "time_centers", "past_quats"):
        assert lost[name].median() <= RULES[name].step * step / 2
        assert lost[name].max() <= 16 * RULES[name].step * step / 2 + 1e-6
    shortest = model.state["log_scales.values"].amin(dim=1).exp()
    nearest = matched(model, found, "log_scales").amin(dim=1).exp()
    pitch = 0.1 * step * np.sqrt(2) * nearest
    assert (lost["means"].amax(dim=1) <= pitch / 2 + 1e-6).all()
    assert (lost["past_means"].amax(dim=(0, 2)) <= pitch / 2 + 1e-6).all()
    assert (lost["motion"].max() <= 0.1 * step * np.sqrt(2) * shortest.max() / 2 + 1e-6).all()
    assert lost["mine"].max() <= 2e-3
    assert lost["huge"].max() == 0
    assert not found.state["stillness.values"].any()
    assert path.stat().st_size < 0.6 * sum(t.nbytes for t in model.state.values())


def test_larger_steps_make_smaller_files(tmp_path):
    sizes = [
        trip(tmp_path, gaussians(), precision="compressed", step=step)[0].stat().st_size
        for step in (0.5, 1.0, 2.0, 4.0)
    ]
    assert sizes == sorted(sizes, reverse=True)
    plain = trip(tmp_path, gaussians())[0].stat().st_size
    assert sizes[1] < plain / 3


@dataclass(frozen=True)
class Measured(ExportSource):
    """A model whose later rows add more to the views."""

    model: StoredModel

    def stored_model(self):
        return self.model

    def contributions(self):
        return 10 ** torch.linspace(-3, 3, COUNT)


def test_rows_that_add_more_have_smaller_steps(tmp_path):
    model = gaussians()
    found = trip(tmp_path, Measured(model), precision="compressed")[1]
    lost = (
        (found.state["log_scales.values"] - matched(model, found, "log_scales")).abs().mean(dim=1)
    )
    weights = torch.cdist(found.state["means.values"], model.state["means.values"]).argmin(dim=1)
    low, high = lost[weights < COUNT // 3].mean(), lost[weights > 2 * COUNT // 3].mean()
    assert low > 4 * high


def test_norms_of_quaternions_are_kept_where_they_may_have_a_meaning(tmp_path):
    still = trip(tmp_path, gaussians(), precision="compressed")[1].state["quats.values"]
    assert torch.allclose(still.norm(dim=1), torch.ones(COUNT), atol=1e-6)
    model = gaussians()
    model.state["field"] = torch.rand(7)
    found = trip(tmp_path, model, precision="compressed")[1]
    norms = matched(model, found, "quats").norm(dim=1)
    assert (found.state["quats.values"].norm(dim=1) - norms).abs().median() < 0.02


def test_rows_keep_their_order_where_other_state_may_follow_it(tmp_path):
    model = moving()
    model.state["graph"] = torch.randint(COUNT, (COUNT, 4))
    found = trip(tmp_path, model, precision="compressed")[1]
    assert torch.equal(found.state["graph"], model.state["graph"])
    assert (found.state["means.values"] - model.state["means.values"]).abs().max() < 0.05
    assert torch.equal(found.state["motion.offsets"], model.state["motion.offsets"])
    lost = found.state["motion.values"] - model.state["motion.values"]
    assert lost.abs().max() < 0.05


def test_models_without_known_columns_are_stored_as_halves(tmp_path):
    found = trip(tmp_path, some_model(), precision="compressed")[1]
    state = some_model().state
    assert torch.equal(found.state["means.values"], state["means.values"])  # No scales: kept.
    assert torch.equal(found.state["motion.values"], state["motion.values"].half().float())
    for name in ("half", "flag", "past.values", "motion.offsets"):
        assert_same_bits(found.state[name], state[name])


def test_the_same_model_makes_the_same_bytes(tmp_path):
    first, second = (
        trip(tmp_path, moving(), precision="compressed")[0].read_bytes() for _ in range(2)
    )
    assert first == second


def test_a_model_that_expands_too_far_makes_a_larger_file(tmp_path):
    zeros = torch.zeros(COUNT, 4000)
    model = gaussians(mine=(Layout.DENSE, zeros))
    path, found = trip(tmp_path, model, precision="compressed")
    assert torch.equal(found.state["mine.values"], zeros)
    assert path.stat().st_size > (zeros.nbytes - 2**20) / 256


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"precision": "float8"}, "format.precision=float8: there is no such precision."),
        ({"precision": "compressed", "step": 0.0}, "format.step=0: expected a factor from 0.01 to"),
        ({"step": 2.0}, "format.step=2: files in float32 have no steps."),
    ],
)
@pytest.mark.unchecked
def test_options_that_make_no_file_are_refused(options, problem):
    with pytest.raises(ConfigError, match=problem):
        ModelFileExporter(**options)


def test_the_description_states_precision_and_bytes_by_column(tmp_path):
    for precision, least in (("float32", 16.0), ("float16", 8.0), ("compressed", 1.0)):
        path, _ = trip(tmp_path, moving(), precision=precision)
        found = describe_model(path)
        assert found["precision"] == precision
        assert found["version"] == (1 if precision == "float32" else 2)
        parts = found["bytes_per_splat_of"]
        assert parts.keys() >= {"quats", "sh_rest", "motion", "rest of the file"}
        assert least <= parts["quats"] < least + 5
        assert ("means" in parts) == (precision != "compressed")
        assert sum(parts.values()) == pytest.approx(path.stat().st_size / COUNT, abs=0.2)


# What is refused when read.


def refusal(path):
    with pytest.raises(DataError) as caught:
        read_model_file(path)
    return caught.value.message.removeprefix(f"{path}: ").removeprefix(f"{path} ")


@pytest.mark.parametrize(
    ("place", "value", "problem"),
    [
        (("precision",), "float64", "its precision is 'float64', which is unknown."),
        (("sorted",), False, "is damaged: means.values: its form is 'positions', with"),
        (("keeps_order",), True, "is damaged: means.values: 1 more bytes were expected"),
        (("arrays", "means.values", "shape"), [1, 3], "is damaged: means.values: it has the "),
        (("arrays", "quats.values", "shape"), [COUNT, 3], "is damaged: quats.values: quaternions "),
        (("arrays", "quats.values", "shape"), [2**40, 4], "is damaged: it announces more state "),
        (("arrays", "quats.values", "shape"), [-1, 4], "coded.arrays.quats.values of its header "),
        (("arrays", "quats.values", "type"), "<U9", "coded.arrays.quats.values of its header "),
        (("arrays", "quats.values", "form"), "round", "is damaged: quats.values: 'round' is not "),
        (("arrays", "quats.values", "step"), -1, "coded.arrays.quats.values.step of its header: "),
        (("arrays", "sh_dc.values", "step"), 1e300, "state/sh_dc.values holds values that are "),
        (("arrays", "sh_dc.values", "shape"), [COUNT, 1], "is damaged: sh_dc.values: colours have"),
    ],
)  # fmt: skip
def test_compressed_headers_that_were_tampered_with_are_refused(tmp_path, place, value, problem):
    path, _ = trip(tmp_path, gaussians(), precision="compressed")
    archive = read_archive(path)
    header = json.loads(json.dumps(dict(archive.header)))
    *outer, last = ("coded", *place)
    found = header
    for key in outer:
        found = found[key]
    found[last] = value
    write_archive(path, ArrayArchive(header, archive.arrays, short=True))
    assert refusal(path).startswith(problem)


@pytest.mark.parametrize("value", [5, None, True, [[1]], "state"])
def test_a_list_of_halves_that_is_none_is_refused(tmp_path, value):
    path, _ = trip(tmp_path, gaussians(), precision="float16")
    archive = read_archive(path)
    coded = {**archive.header["coded"], "halved": value}
    write_archive(path, ArrayArchive({**archive.header, "coded": coded}, archive.arrays))
    assert refusal(path).startswith("coded.halved of its header: expected a list of texts")


def test_missing_bytes_of_a_tensor_are_named(tmp_path):
    path, _ = trip(tmp_path, gaussians(), precision="compressed")
    archive = read_archive(path)
    arrays = {k: v for k, v in archive.arrays.items() if k != "state/sh_dc.values"}
    write_archive(path, ArrayArchive(archive.header, arrays, short=True))
    assert refusal(path) == "is damaged: sh_dc.values: it has no bytes."


@pytest.mark.parametrize("name", ["motion", "mine"])
def test_a_ragged_column_without_any_value_comes_back(tmp_path, name):
    model = gaussians(**{name: (Layout.RAGGED, torch.zeros(0, 2, 3))})
    model.state[f"{name}.offsets"].zero_()
    _, found = trip(tmp_path, model, precision="compressed")
    assert found.state[f"{name}.values"].shape == (0, 2, 3)
    assert torch.equal(found.state[f"{name}.offsets"], model.state[f"{name}.offsets"])


def test_mutated_bytes_are_refused_or_read_as_finite_numbers(tmp_path):
    """The bytes within the archive: those of the archive have a checksum."""
    path, _ = trip(tmp_path, moving(), precision="compressed")
    archive, generator, refused = read_archive(path), np.random.default_rng(0), 0
    names = [name for name in archive.arrays if len(archive.arrays[name])]
    for turn in range(40):
        name = names[turn % len(names)]
        held = archive.arrays[name].copy()
        held[generator.integers(len(held))] ^= 1 << int(generator.integers(8))
        write_archive(
            path, ArrayArchive(archive.header, {**archive.arrays, name: held}, short=True)
        )
        try:
            found = read_model_file(path)
        except DataError:
            refused += 1
            continue
        assert all(t.isfinite().all() for t in found.state.values() if t.is_floating_point())
    assert refused > 5


def test_a_short_header_that_expands_without_end_is_refused(tmp_path):
    path = tmp_path / "a.gsfw"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("header.json.xz", lzma.compress(b" " * (1 << 24)))
    assert "header.json.xz is cut short, or far larger than its" in refusal(path)
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("header.json.xz", b"{}" * 20)
    assert "header.json.xz: Input format not supported by decoder" in refusal(path)
