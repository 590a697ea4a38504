"""Every figure of a variant is what an independent computation gives."""

import dataclasses
import sys

import numpy as np
import pytest
import torch
from support.tradeoff_models import finished_model

from gsfw.commands.main import main
from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.core.loop.evaluation import evaluate
from gsfw.core.loop.memory import added_memory_mb
from gsfw.core.metrics import psnr
from gsfw.formats.ply import PlyImporter
from gsfw.plugins.exporters import make_exporter
from gsfw.plugins.registry import installed
from gsfw.studies.tradeoff.catalogue import catalogue
from gsfw.studies.tradeoff.finished_model import PROBE_SIDE, PROBES, LeftOut, evenly
from gsfw.studies.tradeoff.flip import flip
from gsfw.studies.tradeoff.record import RecordStore
from gsfw.studies.tradeoff.runner import Runner
from gsfw.studies.tradeoff.variant import AXES

# Seconds each; .ci/run runs them.
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def model(finished_run):
    return finished_model(finished_run)


@pytest.fixture(scope="module")
def variants(model):
    found, left_out = catalogue(model, AXES)
    assert left_out == [LeftOut("time", "the model does not move")]
    return {variant.key: variant for variant in found}


@pytest.fixture(scope="module")
def records(model, variants, tmp_path_factory):
    store = RecordStore(tmp_path_factory.mktemp("tradeoff") / "t.json", model.fingerprint())
    runner = Runner(model, list(variants.values()), store)
    assert [v.key for v in runner.measure()] == list(variants)
    assert list(runner.time(2)) == [1, 2]
    assert runner.rounds_left(2) == 0
    return store.records


def test_the_model_as_it_is_has_the_figures_of_gsfw_eval(model, records):
    parts, settings = model.parts, model.subject.settings
    expected = evaluate(parts, settings)
    first = records[("as it is", "as it is")]
    assert first.means == expected.means
    assert first.floats == 150 * 59
    assert first.parameter_bytes == parts.model.summary()["model_bytes"]
    assert first.relative_l2 < 1e-5


def test_every_axis_is_there_and_can_be_drawn(records):
    assert {axis for axis, _ in records} == {"as it is", *AXES} - {"time"}
    for record in records.values():
        assert record.failure == "", record
        assert len(record.readings) == (0 if record.draws_alike else 2)


def test_sh_truncation_has_the_accuracy_of_zeroed_coefficients(model, records):
    copy = finished_model(model.restored.folder.path)
    with torch.no_grad():
        copy.parts.model.sh_rest.values[:, 3:] = 0
    (batch,) = copy.parts.data.load(Split.EVAL, [0], copy.device)
    image = copy.subject.image(copy.subject.splats(), batch.cameras)
    expected = psnr(image, batch.target(copy.subject.settings.background)[0])
    record = records[("sh", "degree 1")]
    assert record.per_view[0]["psnr"] == pytest.approx(expected, abs=1e-4)
    assert record.floats == 150 * (11 + 12)


def test_precision_rounds_every_parameter_as_numpy_does(model, variants, records):
    subject = variants[("precision", "fp16")].change(model.subject)
    for name, column in model.parts.model.columns().items():
        expected = column.values.detach().numpy().astype(np.float16).astype(np.float32)
        found = subject.model.columns()[name].values.detach().numpy()
        assert np.array_equal(found, expected), name
    bits = model.parts.model.means.values.detach().numpy().view(np.uint32).astype(np.uint64)
    nearest_even = ((bits + 0x7FFF + ((bits >> 16) & 1)) >> 16) << 16
    rounded = variants[("precision", "bf16")].change(model.subject).model.means.values
    assert np.array_equal(rounded.detach().numpy().view(np.uint32), nearest_even.astype(np.uint32))
    assert records[("precision", "fp16")].parameter_bytes == 150 * 59 * 2


def test_pruning_leaves_the_gaussians_that_add_most(model, variants, records):
    kept = variants[("prune", "keep 25%")].change(model.subject).splats()
    order = model.scores.argsort(descending=True)[:38]
    assert records[("prune", "keep 25%")].num_gaussians == 38
    assert torch.equal(kept.means, model.subject.splats().means[order.sort().values])


def test_sizes_are_those_of_the_files_that_the_commands_write(model, records, tmp_path, capsys):
    run = str(model.restored.folder.path)
    written = [record for record in records.values() if record.file]
    formats = [record for record in records.values() if record.axis == "format"]
    assert {"ply", "gsfw", "gsfw precision=float16"} <= {record.name for record in formats}
    assert len(written) == 1 + 3 + 4 + len(formats) + 2
    for number, record in enumerate(written[::3]):
        verb, *words = record.command
        form = next((word for word in words if word.startswith("format=")), "format=ply")
        suffix = make_exporter(form.removeprefix("format="), installed()).suffix
        out = tmp_path / f"{number}{suffix}"
        assert main([verb, run, *words, f"out={out}"]) == 0
        assert out.stat().st_size == record.file_bytes, record.name


def test_compressed_files_of_larger_steps_are_smaller_and_worse(model, records):
    names = [f"gsfw precision=compressed step={step}" for step in ("0.5", "1", "2", "3")]
    found = [records[("format", name)] for name in names]
    sizes, psnr = [r.file_bytes for r in found], [r.psnr for r in found]
    assert sizes == sorted(sizes, reverse=True)
    assert psnr[0] >= psnr[-1]
    assert records[("format", "gsfw precision=float16")].file_bytes > 2 * sizes[0]
    assert found[1].command == [
        *("export", "format=gsfw", "format.precision=compressed", "format.step=1"),
    ]


def test_an_exported_file_holds_the_splats_of_its_variant(model, variants, tmp_path, capsys):
    out = tmp_path / "small.ply"
    words = ["keep=0.75", "sh_degree=1"]
    assert main(["export", str(model.restored.folder.path), *words, f"out={out}"]) == 0
    content = PlyImporter().read(out).splats
    subject = variants[("combined", "keep 75%, degree 1")].change(model.subject).splats()
    assert (len(content), content.colors.degree) == (len(subject), 1)
    assert content.opacities.numpy() == pytest.approx(subject.opacities.numpy(), abs=1e-6)


def test_float64_and_reference_tell_errors_of_numbers_from_those_of_the_model(records):
    assert records[("backend", "cpu, float64")].relative_l2 < 1e-13
    assert records[("backend", "reference, float32")].relative_l2 < 1e-5
    assert records[("sh", "degree 0")].relative_l2 > 1e-5
    assert records[("prune", "keep 25%")].max_error > 0.01


def test_half_the_resolution_is_drawn_and_enlarged(model, variants):
    camera = model.cameras[0]
    half = variants[("resolution", "1/2, enlarged")].change(model.subject)
    splats = half.splats()
    small = model.subject.image(splats, camera.resized(16, 12))
    image = half.image(splats, camera)
    assert image.shape == (24, 32, 3)
    # Pixels of the small image lie at odd positions of a grid of quarters: 9, 3, 3 and 1 of 16.
    corners = small[2:4, 4:6]
    weights = torch.tensor([[9.0, 3.0], [3.0, 1.0]])[..., None] / 16
    torch.testing.assert_close(image[5, 9], (corners * weights).sum((0, 1)))


def test_what_is_measured_is_not_measured_again(model, variants, records, tmp_path):
    store = RecordStore(tmp_path / "t.json", model.fingerprint())
    runner = Runner(model, list(variants.values())[:4], store)
    measuring = runner.measure()
    next(measuring)
    measuring.close()
    again = Runner(model, runner.variants, RecordStore(store.path, model.fingerprint()))
    assert [v.name for v in again.missing] == ["degree 2", "degree 1", "degree 0"]
    list(again.measure())
    list(again.time(1))
    assert again.rounds_left(3) == 2


def test_flip_is_the_mean_over_some_views_against_the_photos(model, records):
    pytest.importorskip("flip_evaluator")
    subject, each = model.subject, []
    for view in (0, 1):
        (batch,) = model.parts.data.load(Split.EVAL, [view], model.device)
        photo = batch.target(subject.settings.background)[0]
        each.append(flip(subject.image(subject.splats(), batch.cameras), photo, None))
    assert records[("as it is", "as it is")].flip == pytest.approx(sum(each) / 2)
    assert records[("resolution", "1/2, enlarged")].flip != pytest.approx(sum(each) / 2)


def test_flip_alone_is_measured_where_it_is_missing(model, variants, records, tmp_path):
    pytest.importorskip("flip_evaluator")
    first = variants[("as it is", "as it is")]
    store = RecordStore(tmp_path / "t.json", "x")
    known = dataclasses.replace(records[first.key], flip=None, per_view=[{"psnr": 1.0}])
    store.keep(known)
    runner = Runner(model, [first], store)
    assert runner.missing == [first]
    list(runner.measure())
    expected = dataclasses.replace(known, flip=records[first.key].flip)
    assert store.records == {first.key: expected}
    assert runner.missing == []


def test_without_the_package_flip_is_not_known_and_nothing_is_missing(
    model, variants, tmp_path, monkeypatch
):
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    first = variants[("as it is", "as it is")]
    runner = Runner(model, [first], RecordStore(tmp_path / "t.json", "x"))
    list(runner.measure())
    assert runner.missing == []
    assert runner.store.records[first.key].flip is None


def test_memory_is_known_of_all_that_is_drawn_in_its_own_way(records):
    if added_memory_mb(lambda: None, torch.device("cpu")) is None:
        pytest.skip("this system does not say how much memory a piece of work takes")
    for record in records.values():
        assert (record.peak_memory_mb is None) == record.draws_alike, record
    # Plain torch holds what the kernels never write down.
    reference = records[("backend", "reference, float32")].peak_memory_mb
    assert reference > records[("as it is", "as it is")].peak_memory_mb


def test_what_cannot_be_drawn_is_a_failure_with_its_reason(model, variants, tmp_path):
    def ruined(subject):
        return dataclasses.replace(
            subject,
            edits=(
                lambda splats, camera: dataclasses.replace(
                    splats, scales=splats.scales * torch.inf
                ),
            ),
        )

    broken = dataclasses.replace(variants[("precision", "fp16")], change=ruined)
    store = RecordStore(tmp_path / "t.json", "x")
    list(Runner(model, [broken], store).measure())
    (record,) = store.records.values()
    assert record.failure.startswith("splats.scales: expected finite values; 150 of 150 rows")
    assert (record.psnr, record.relative_l2) == (None, None)


def test_views_are_taken_from_the_middles_of_equal_parts():
    assert evenly(16, 4) == [2, 6, 10, 14]
    assert evenly(3, 4) == [0, 1, 2]


def test_probes_are_few_and_small(model):
    assert len(model.probes) == PROBES
    assert all(max(camera.width, camera.height) <= PROBE_SIDE for camera in model.probes)


def test_the_fingerprint_follows_parameters_and_views(finished_run, model):
    fewer = finished_model(finished_run, views=1)
    assert len(fewer.names) == 1
    assert fewer.fingerprint() != model.fingerprint()
    same = finished_model(finished_run)
    assert same.fingerprint() == model.fingerprint()
    with torch.no_grad():
        same.parts.model.means.values[0, 0] += 1e-3
    assert same.fingerprint() != model.fingerprint()


def test_a_run_that_holds_nothing_out_is_refused(finished_run, monkeypatch):
    from gsfw.core.datamanager import Views

    found = finished_model(finished_run)
    monkeypatch.setattr(type(found.parts.data), "views", lambda self, split: Views((), ()))
    with pytest.raises(DataError) as caught:
        type(found)(found.restored, found.registry, "runs/a", 4)
    assert str(caught.value) == (
        "runs/a has no held-out images to measure accuracy on.\n"
        "Train a run that holds some out: holdout_every=8."
    )
