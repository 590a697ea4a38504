"""SOG: what is written is what PlayCanvas describes, and comes back within its steps."""

import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from support.scenes import front_camera, random_splats
from support.sog_files import entries, legacy, unpacked
from support.splat_transform import needs_splat_transform, splat_transform

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import SplatFile
from gsfw.core.metrics import psnr
from gsfw.core.render_settings import RenderSettings
from gsfw.formats.morton_order import morton_order
from gsfw.formats.ply import PlyExporter, PlyImporter
from gsfw.formats.sog import sh_palette
from gsfw.formats.sog.exporter import SogExporter
from gsfw.formats.sog.importer import SogImporter
from gsfw.formats.sog.sh_palette import palette_size
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

TURN = 2 * np.sqrt(1 + 1.78**2) * np.sqrt(3) * np.sqrt(2) / 510
"""Largest angle between a rotation and what is stored of it: formats/sog/quantisation.py."""


def splats(n=300, degree=3, **changes):
    return replace(random_splats(n, degree, dtype=torch.float64), **changes)


def write(path, content, **options):
    content = content if isinstance(content, SplatFile) else SplatFile(content)
    SogExporter(**options).write(path, content)
    return path


def read(path):
    return SogImporter().read(path)


def in_order(given):
    return given.take(morton_order(given.means))


def document(path):
    return json.loads(entries(path)["meta.json"])


def check_within_steps(given, found, meta, opacity_step=0.5):
    """Every value within the error that formats/sog/quantisation.py derives."""
    step = (np.array(meta["means"]["maxs"]) - np.array(meta["means"]["mins"])) / 65535
    means = given.means.numpy()
    # The rounding of float32, in which other tools compute, comes on top.
    bound = (np.abs(means) + 1) * np.expm1(step / 2) + 1e-6 * (np.abs(means) + 1)
    assert (np.abs(found.means.numpy() - means) <= bound).all()
    opacities = (found.opacities - given.opacities).abs()
    assert float(opacities.max()) <= opacity_step / 255 + 2e-6
    length = given.quats.norm(dim=1) * found.quats.norm(dim=1)
    cosine = (given.quats * found.quats).sum(dim=1).abs() / length
    assert float(2 * cosine.clamp(max=1).acos().max()) <= TURN + 1e-6
    for levels, values, stored in (
        (meta["scales"]["codebook"], given.scales.log(), found.scales.log()),
        (meta["sh0"]["codebook"], given.colors.coefficients[:, 0], found.colors.coefficients[:, 0]),
    ):
        distances = (values.reshape(-1, 1) - torch.tensor(levels, dtype=torch.float64)).abs()
        error = (stored - values).abs().reshape(-1)
        assert torch.allclose(error.double(), distances.min(dim=1).values.double(), atol=3e-6)


def sh_error(given, found):
    """Root of the mean squared error of the higher SH coefficients."""
    first, second = (file.colors.coefficients[:, 1:].double() for file in (given, found))
    return float((first - second).square().mean().sqrt())


@pytest.mark.parametrize("degree", range(4))
def test_values_come_back_within_the_steps_of_the_format(tmp_path, degree):
    given = splats(degree=degree)
    spread = torch.randn(300, 1, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    given = replace(
        given, means=given.means * (3 * spread).exp(), scales=given.scales * spread.exp()
    )
    path = write(tmp_path / "a.sog", given)
    content = read(path)
    assert content.splats.colors.degree == degree
    assert content.num_dropped == 0
    check_within_steps(in_order(given), content.splats, document(path))
    # 256 vectors for 300 splats, of which those that matter least share some.
    spread = float(given.colors.coefficients[:, 1:].std()) if degree else 1.0
    assert degree == 0 or sh_error(in_order(given), content.splats) < 0.4 * spread


def test_the_files_are_those_that_playcanvas_describes(tmp_path):
    path = write(tmp_path / "a.sog", SplatFile(splats(300, 2), antialiased=True))
    files = entries(path)
    meta = document(path)
    assert list(files) == [
        "meta.json",
        *("means_l.webp", "means_u.webp", "quats.webp", "scales.webp", "sh0.webp"),
        *("shN_centroids.webp", "shN_labels.webp"),
    ]
    assert meta["version"] == 2
    assert meta["count"] == 300
    assert meta["model"] == "antialiased"
    assert meta["shN"]["bands"] == 2
    assert [len(meta[key]["codebook"]) for key in ("scales", "sh0", "shN")] == [256, 256, 256]
    images = {name: Image.open(io.BytesIO(files[name])) for name in list(files)[1:]}
    assert {image.format for image in images.values()} == {"WEBP"}
    assert images["quats.webp"].size == (20, 16)
    assert images["shN_centroids.webp"].size == (64 * 8, -(-meta["shN"]["count"] // 64))
    tags = np.asarray(images["quats.webp"])[..., 3].ravel()[:300]
    assert set(tags) == {252, 253, 254, 255}
    with zipfile.ZipFile(path) as archive:
        assert {entry.compress_type for entry in archive.infolist()} == {zipfile.ZIP_STORED}


def test_the_same_splats_give_the_same_bytes(tmp_path):
    first = write(tmp_path / "a.sog", splats(500, 1)).read_bytes()
    assert write(tmp_path / "b.sog", splats(500, 1)).read_bytes() == first


@pytest.mark.parametrize("antialiased", [False, True])
def test_antialiasing_is_written_and_read(tmp_path, antialiased):
    content = read(write(tmp_path / "a.sog", SplatFile(splats(5, 0), antialiased=antialiased)))
    assert content.antialiased == antialiased
    assert content.properties["version"] == "2"
    assert content.properties["generator"].startswith("gsfw ")


def test_the_first_proposals_flag_for_antialiasing_is_read(tmp_path):
    path = write(tmp_path / "a.sog", SplatFile(splats(5, 0), antialiased=True))
    folder = unpacked(path, tmp_path / "folder", lambda meta: meta.pop("model"))
    assert read(folder / "meta.json").antialiased


def test_a_description_beside_its_images_is_read_like_the_archive(tmp_path):
    path = write(tmp_path / "a.sog", splats())
    folder = unpacked(path, tmp_path / "folder")
    for given in (folder, folder / "meta.json"):
        assert SogImporter.recognises(given)
        again = read(given).splats.tensors()
        assert all(
            torch.equal(again[name], value) for name, value in read(path).splats.tensors().items()
        )


def test_images_of_other_names_and_formats_are_read(tmp_path):
    path = write(tmp_path / "a.sog", splats())
    folder = unpacked(
        path, tmp_path / "folder", lambda meta: meta["quats"].update(files=["q 1.png"])
    )
    Image.open(folder / "quats.webp").save(folder / "q 1.png")
    (folder / "quats.webp").unlink()
    assert torch.equal(read(folder).splats.quats, read(path).splats.quats)


def test_one_splat_and_splats_at_one_place_come_back(tmp_path):
    for number, given in enumerate((splats(1, 3), splats(9, 1, means=torch.ones(9, 3).double()))):
        content = read(write(tmp_path / f"{number}.sog", given))
        assert torch.allclose(content.splats.means, in_order(given).means, atol=1e-9)
        assert len(content.splats) == len(given)


@pytest.mark.parametrize("side", [1, 16])
def test_scenes_whose_images_compress_to_almost_nothing_come_back(tmp_path, side):
    steps = torch.arange(side, dtype=torch.float64)
    grid = torch.cartesian_prod(steps, steps, steps) if side > 1 else torch.zeros(3000, 3).double()
    given = replace(splats(1, 0).take(torch.zeros(len(grid), dtype=torch.long)), means=grid)
    path = write(tmp_path / "a.sog", given)
    assert sum(len(content) for name, content in entries(path).items() if "webp" in name) < 4096
    content = read(path)
    assert (len(content.splats), content.num_dropped) == (len(grid), 0)
    assert torch.allclose(content.splats.means, in_order(given).means, atol=1e-3)


def test_opacities_of_0_and_1_come_back_as_such(tmp_path):
    opacities = torch.tensor([0.0, 1e-9, 0.5, 1 - 1e-9, 1.0], dtype=torch.float64)
    given = in_order(splats(5, 0, opacities=opacities))
    found = read(write(tmp_path / "a.sog", given)).splats.opacities
    assert torch.allclose(found, given.opacities, atol=0.5 / 255)


def test_the_palette_is_the_largest_power_of_two_and_labels_have_16_bits():
    sizes = {1: 1, 2: 2, 3: 2, 1023: 512, 1024: 1024, 65535: 32768, 65536: 65536, 10**7: 65536}
    assert {count: palette_size(count) for count in sizes} == sizes


def test_the_palette_is_an_option(tmp_path):
    given = splats(500, 1)
    errors, sizes = [], []
    for number, palette in enumerate((50, 0, 500)):
        path = write(tmp_path / f"{number}.sog", given, palette=palette)
        assert document(path)["shN"]["count"] <= (palette or 256)
        errors.append(sh_error(in_order(given), read(path).splats))
        sizes.append(path.stat().st_size)
    assert sizes == sorted(sizes)
    assert errors == sorted(errors, reverse=True)
    assert errors[2] < 0.01
    with pytest.raises(ConfigError, match="palette=65537: expected 1 to 65536 vectors, or 0"):
        SogExporter(palette=65537)


def test_splats_beyond_the_sample_get_the_nearest_vectors(tmp_path, monkeypatch):
    given = splats(1500, 1)
    whole = sh_error(in_order(given), read(write(tmp_path / "a.sog", given)).splats)
    monkeypatch.setattr(sh_palette, "MAX_FITTED", 1200)
    part = sh_error(in_order(given), read(write(tmp_path / "b.sog", given)).splats)
    assert whole <= part < 2 * whole


def test_bands_above_degree_3_are_left_out(tmp_path):
    given = splats(300, 4)
    path = write(tmp_path / "a.sog", given)
    lower = replace(given, colors=replace(given.colors, degree=3))
    assert path.read_bytes() == write(tmp_path / "b.sog", lower).read_bytes()
    assert read(path).splats.colors.degree == 3


def test_version_1_is_read(tmp_path):
    meta, texels = legacy(tmp_path / "old", range(50))
    content = read(tmp_path / "old" / "meta.json")
    found = content.splats
    assert content.properties == {"version": "1"}
    low, high = (np.array(meta["scales"][key]) for key in ("mins", "maxs"))
    part = (texels["means_l"] + 256 * texels["means_u"])[:50, :3] / 65535
    logarithms = low + (high - low) * part
    means = np.sign(logarithms) * (np.exp(np.abs(logarithms)) - 1)
    assert np.allclose(found.means, means)
    assert np.allclose(found.scales.log(), low + (high - low) * texels["scales"][:50, :3] / 255)
    assert np.allclose(found.opacities.logit(), -5 + 10 * texels["sh0"][:50, 3] / 255, atol=1e-5)
    assert np.allclose(found.colors.coefficients[:, 0], texels["sh0"][:50, :3] / 255)
    vectors = texels["shN_centroids"][:, :3].reshape(64, 3, 3) / 255 - 0.5
    labels = texels["shN_labels"][:50, 0].astype(int)
    assert np.allclose(found.colors.coefficients[:, 1:], vectors[labels], atol=1e-6)


def test_an_exported_file_draws_nearly_the_same_image(tmp_path):
    given = splats(60, 3)
    path = write(tmp_path / "a.sog", given, palette=60)
    again = read(path).splats.map(torch.Tensor.double)
    camera, settings = front_camera(dtype=torch.float64), RenderSettings()
    before = ReferenceRasterizer().render(in_order(given), camera, settings).color
    after = ReferenceRasterizer().render(again, camera, settings).color
    assert float(psnr(after[0].clamp(0, 1), before[0].clamp(0, 1))) > 40


def test_a_real_file_comes_back_within_the_steps(tmp_path, shared_data):
    given = PlyImporter().read(shared_data / "splats" / "inria_sh3_9080.ply").splats
    given = given.take(torch.arange(0, 9080, 9))
    path = write(tmp_path / "a.sog", given)
    check_within_steps(in_order(given), read(path).splats, document(path))


@pytest.mark.slow
@needs_splat_transform
def test_splat_transform_reads_what_is_written(tmp_path, shared_data):
    source = shared_data / "splats" / "inria_sh3_9080.ply"
    content = PlyImporter().read(source)
    path = write(tmp_path / "a.sog", content)
    splat_transform(path, tmp_path / "b.ply")
    ours, theirs = read(path).splats, PlyImporter().read(tmp_path / "b.ply").splats
    check_within_steps(in_order(content.splats), theirs, document(path))
    assert torch.allclose(ours.means, theirs.means, rtol=1e-5, atol=1e-6)
    assert torch.equal(ours.colors.coefficients, theirs.colors.coefficients)
    assert torch.allclose(ours.quats, theirs.quats, atol=1e-5)
    folder = unpacked(path, tmp_path / "folder")
    splat_transform(folder / "meta.json", tmp_path / "c.ply")
    again = PlyImporter().read(tmp_path / "c.ply").splats
    assert torch.equal(again.means, theirs.means)


@pytest.mark.slow
@needs_splat_transform
def test_what_splat_transform_writes_is_read_and_ours_is_no_worse(tmp_path, shared_data):
    content = PlyImporter().read(shared_data / "splats" / "inria_sh3_9080.ply")
    some = SplatFile(content.splats.take(torch.arange(0, 9080, 5)))
    PlyExporter().write(tmp_path / "a.ply", some)
    splat_transform(tmp_path / "a.ply", tmp_path / "theirs.sog")
    splat_transform(tmp_path / "theirs.sog", tmp_path / "theirs.ply")
    theirs = read(tmp_path / "theirs.sog")
    assert theirs.properties["generator"] == "splat-transform v2.7.1"
    again = PlyImporter().read(tmp_path / "theirs.ply").splats
    assert torch.allclose(theirs.splats.means, again.means, rtol=1e-5, atol=1e-6)
    assert torch.equal(theirs.splats.colors.coefficients, again.colors.coefficients)
    assert torch.allclose(theirs.splats.quats, again.quats, atol=1e-5)
    assert torch.allclose(theirs.splats.opacities, again.opacities, atol=1e-6)
    ours = write(tmp_path / "ours.sog", some)
    assert ours.stat().st_size <= Path(tmp_path / "theirs.sog").stat().st_size
