"""USD files of other tools: transforms, instances, missing values, damage; usd-core writes them."""

import zipfile

import pytest
from pxr import Gf, Usd, UsdGeom, Vt
from support.usd_files import shapes, written

from gsfw.core.errors import DataError
from gsfw.formats.usd.importer import UsdImporter


@pytest.mark.slow
def test_a_field_of_positions_alone_gets_the_defaults_of_the_schema(tmp_path):
    found = UsdImporter().read(written(tmp_path / "a.usda"))
    assert found.up == "-y"
    assert found.splats.means[3].tolist() == [3, -2, -3]
    assert found.splats.scales.unique().tolist() == [1]
    assert found.splats.opacities.unique().tolist() == pytest.approx([1])
    # Half a turn about x, from the axes of the stage to those of the data.
    assert found.splats.quats.abs().tolist() == [pytest.approx([0, 1, 0, 0])] * 4
    assert found.splats.colors.coefficients.unique().tolist() == [0]


@pytest.mark.slow
def test_arrays_of_16_bits_are_read_unless_there_are_32(tmp_path):
    def edit(stage, field):
        field.CreateScaleshAttr(Vt.Vec3hArray([Gf.Vec3h(0.25, 0.5, 1)] * 4))
        field.CreateOpacitieshAttr(Vt.HalfArray([0.25] * 4))
        field.CreateOpacitiesAttr(Vt.FloatArray([0.75] * 4))

    found = UsdImporter().read(written(tmp_path / "a.usdc", edit=edit)).splats
    assert found.scales[0].tolist() == pytest.approx([0.25, 0.5, 1])
    assert found.opacities.tolist() == pytest.approx([0.75] * 4)


@pytest.mark.slow
def test_longer_arrays_are_cut_and_shorter_ones_do_not_count(tmp_path):
    def edit(stage, field):
        field.CreateScalesAttr(Vt.Vec3fArray([Gf.Vec3f(0.5)] * 3))
        field.CreateOpacitiesAttr(Vt.FloatArray([0.25] * 4 + [0.5] * 3))

    found = UsdImporter().read(written(tmp_path / "a.usdc", edit=edit)).splats
    assert found.scales.unique().tolist() == [1]
    assert found.opacities.tolist() == pytest.approx([0.25] * 4)


@pytest.mark.slow
def test_prims_place_turn_and_scale_their_fields(tmp_path):
    def edit(stage, field):
        field.CreateScalesAttr(Vt.Vec3fArray([Gf.Vec3f(0.1, 0.2, 0.3)] * 4))
        place = UsdGeom.Xformable(stage.GetPrimAtPath("/World"))
        place.AddTranslateOp().Set(Gf.Vec3d(10, 0, 0))
        place.AddRotateZOp().Set(90.0)
        place.AddScaleOp().Set(Gf.Vec3f(2))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)

    found = UsdImporter().read(written(tmp_path / "a.usda", edit=edit))
    assert found.up == "z"
    assert found.splats.means[1].tolist() == pytest.approx([10 - 4, 2, 6])
    sizes = shapes(found.splats)[0].diagonal().sqrt()
    assert sizes.tolist() == pytest.approx([0.4, 0.2, 0.6], abs=1e-6)


@pytest.mark.slow
def test_all_visible_fields_are_read_also_of_instances_and_other_files(tmp_path):
    written(tmp_path / "part.usdc")
    stage = Usd.Stage.CreateNew(str(tmp_path / "whole.usda"))
    for name in ("One", "Two", "Hidden"):
        prim = UsdGeom.Xform.Define(stage, f"/{name}").GetPrim()
        prim.GetReferences().AddReference("part.usdc", "/World")
        prim.SetInstanceable(name != "Hidden")
    UsdGeom.Imageable(stage.GetPrimAtPath("/Hidden")).MakeInvisible()
    UsdGeom.Xformable(stage.GetPrimAtPath("/Two")).AddTranslateOp().Set(Gf.Vec3d(0, 0, 50))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.Save()
    found = UsdImporter().read(tmp_path / "whole.usda")
    assert found.properties["sets of splats"] == "2"
    assert sorted(found.splats.means[:, 2].tolist()) == pytest.approx([3] * 4 + [53] * 4)


@pytest.mark.slow
def test_a_small_file_that_repeats_its_splats_without_end_is_refused(tmp_path):
    part = written(tmp_path / "part.usda", count=10_000)
    stage = Usd.Stage.CreateInMemory()
    for number in range(130):
        prim = UsdGeom.Xform.Define(stage, f"/P{number}").GetPrim()
        prim.GetReferences().AddReference(str(part), "/World")
    stage.GetRootLayer().Export(str(tmp_path / "a.usdc"))
    with pytest.raises(DataError, match="announces 1300000 splats, which its size does not"):
        UsdImporter().read(tmp_path / "a.usdc")


def refusal(path):
    with pytest.raises(DataError) as caught:
        UsdImporter().read(path)
    return str(caught.value).replace(str(path), "FILE")


@pytest.mark.slow
def test_files_without_splats_and_damaged_files_are_refused_with_the_reason(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "mesh.usda"))
    UsdGeom.Sphere.Define(stage, "/Ball")
    stage.Save()
    assert refusal(tmp_path / "mesh.usda").startswith(
        "FILE contains no splats: none of its prims is a ParticleField3DGaussianSplat.\n"
    )
    for number, content in enumerate((b"PXR-USDC", b"PXR-USDC" + bytes(200), b"#usda 1.0\n{{")):
        path = tmp_path / f"damaged-{number}.usd"
        path.write_bytes(content)
        assert UsdImporter.recognises(path)
        assert refusal(path).startswith("FILE is a damaged file of USD, or refers to a file that")

    def edit(stage, field):
        field.CreateRadianceSphericalHarmonicsDegreeAttr(9)

    said = refusal(written(tmp_path / "nine.usda", edit=edit))
    assert said.startswith("FILE: /World/Splats has colours of SH degree 9; degrees 0 to 4 are")
    empty = refusal(written(tmp_path / "empty.usda", count=0))
    assert empty.startswith("FILE contains no splats: it has no rows.")


def packed(path, compression=zipfile.ZIP_STORED, **entries):
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in entries.items():
            archive.writestr(name.replace("_", "."), content)
    return path


@pytest.mark.slow
def test_damaged_packages_are_refused_with_the_reason(tmp_path):
    """OpenUSD searches some of them without end."""
    stage = written(tmp_path / "a.usda").read_bytes()
    whole = packed(tmp_path / "whole.usdz", b_usda=stage, c_png=b"no image")
    assert len(UsdImporter().read(whole).splats) == 4
    (tmp_path / "cut.usdz").write_bytes(whole.read_bytes()[:-40])
    assert refusal(tmp_path / "cut.usdz").startswith("FILE is a damaged package of USD.")
    small = packed(tmp_path / "small.usdz", zipfile.ZIP_DEFLATED, b_usda=stage)
    assert refusal(small).startswith("FILE is a damaged package of USD.")
    outside = packed(tmp_path / "outside.usdz", **{"../b_usda": stage})
    assert refusal(outside).startswith("FILE is a damaged package of USD.")
    assert not (tmp_path.parent / "b.usda").exists()
    other = packed(tmp_path / "other.usdz", c_png=b"no image")
    assert refusal(other).startswith("FILE contains no splats: there is no stage of USD in")


@pytest.mark.slow
def test_rows_that_are_not_finite_are_dropped_and_counted(tmp_path):
    def edit(stage, field):
        field.CreateOpacitiesAttr(Vt.FloatArray([0.5, float("nan"), 0.5, 0.5]))
        field.CreateScalesAttr(Vt.Vec3fArray([Gf.Vec3f(-1)] + [Gf.Vec3f(1)] * 3))

    found = UsdImporter().read(written(tmp_path / "a.usda", edit=edit))
    assert (len(found.splats), found.num_dropped) == (2, 2)
