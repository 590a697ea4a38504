"""SPZ files that other tools write, and ours as they read them."""

from dataclasses import replace

import pytest
import torch
from support.splat_files import alignment, largest, trained_splats
from support.splat_transform import (
    WITH_LEVELS,
    needs_splat_transform,
    needs_splat_transform_with_levels,
    splat_transform,
)
from support.spz_files import check_within_quantisation, read, write

from gsfw.commands.main import main
from gsfw.core.exchange import SplatFile
from gsfw.formats.ply import PlyExporter, PlyImporter

pytestmark = pytest.mark.slow


@needs_splat_transform
@pytest.mark.parametrize(("version", "sh_bits"), [(2, 4), (3, 4), (4, 4), (3, 8)])
def test_another_tool_reads_what_is_written(tmp_path, version, sh_bits):
    given = trained_splats(3000, 3)
    path = write(tmp_path / "a.spz", SplatFile(given), version, sh_bits)
    splat_transform(path, tmp_path / "a.ply")
    other = PlyImporter().read(tmp_path / "a.ply").splats
    check_within_quantisation(given, other, version, sh_bits=sh_bits)
    # Both readers see the same numbers.
    ours = read(path).splats
    assert largest(other.means, ours.means) < 1e-6
    assert largest(other.colors.coefficients, ours.colors.coefficients) < 1e-6
    assert alignment(other.quats, ours.quats) > 1 - 1e-6


@needs_splat_transform
def test_what_another_tool_writes_is_read(tmp_path):
    given = trained_splats(3000, 3)
    PlyExporter().write(tmp_path / "a.ply", SplatFile(given))
    splat_transform(tmp_path / "a.ply", tmp_path / "a.spz")
    content = read(tmp_path / "a.spz")
    check_within_quantisation(given, content.splats, int(content.properties["version"]))


@needs_splat_transform_with_levels
def test_half_a_turn_sets_what_splat_transform_3_writes_upright(tmp_path):
    given, (ply, spz, back) = (
        trained_splats(3000, 3),
        [tmp_path / f"a.{end}" for end in ("ply", "spz", "b.ply")],
    )
    PlyExporter().write(ply, SplatFile(given))
    splat_transform(ply, spz, version=WITH_LEVELS)
    assert main(["edit", str(spz), "rotate=x,180", f"out={back}"]) == 0
    found = PlyImporter().read(back).splats
    # Half a turn of an ellipsoid about an axis of its own is none: q and q i are the same one.
    units = torch.nn.functional.normalize(found.quats, dim=1)
    same = replace(found, quats=units[:, [1, 0, 3, 2]] * torch.tensor([-1.0, 1.0, 1.0, -1.0]))
    check_within_quantisation(given, same, int(read(spz).properties["version"]))


@needs_splat_transform
def test_two_files_of_the_same_scene_agree(tmp_path, shared_data):
    ours = read(shared_data / "splats" / "biker.spz").splats
    splat_transform(shared_data / "splats" / "biker.compressed.ply", tmp_path / "a.ply")
    other = PlyImporter().read(tmp_path / "a.ply").splats
    assert len(ours) == len(other)
    assert largest(ours.means, other.means) < 3e-3
    assert float((ours.means - other.means).abs().median()) < 2e-4
    assert float((ours.opacities - other.opacities).abs().max()) < 0.01
    assert float((ours.scales.log() - other.scales.log()).abs().median()) < 0.05
    same = (ours.quats * other.quats).sum(dim=1).abs()
    assert float(same.median()) > 0.9999
