import json
import shutil

import numpy as np
import pytest
import torch
from support.street import write_street

from gsfw.commands.main import main
from gsfw.core.datamanager import DataRequest, Split
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.loop.evaluation import render_model
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.render_settings import RenderSettings
from gsfw.partition.block_data import BlocksConfig
from gsfw.partition.document import FILE, read_partition
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore


@pytest.fixture
def cut(tmp_path):
    write_street(tmp_path / "street")
    assert main(["partition", str(tmp_path / "street"), f"out={tmp_path / 'cut'}", "blocks=2"]) == 0
    return tmp_path / "cut"


def test_a_block_has_its_views_and_points_and_none_that_is_held_out(cut):
    partition = read_partition(cut)
    held = set(partition.held_out)
    for block in partition.blocks:
        data = BlocksConfig(block=block.name).build(DataRequest(cut))
        assert set(data.views(Split.TRAIN).names) == set(block.train)
        assert not held & set(block.train)
        assert set(data.views(Split.EVAL).names) == set(block.evaluation) <= held
        places = partition.ground.places(data.recording.points.numpy())
        assert block.cell.holds(places, block.margin).all()
        assert len(places) > block.points  # Those of the margin.
        data.close()


def test_blocks_together_have_every_point_once(cut):
    partition = read_partition(cut)
    assert sum(block.points for block in partition.blocks) == 400


def test_without_a_block_it_is_the_whole_data_set(cut):
    data = BlocksConfig(points=100).build(DataRequest(cut))
    names = [*data.views(Split.TRAIN).names, *data.views(Split.EVAL).names]
    assert len(names) == 16
    assert len(data.scene.points) == 100
    data.close()


def test_settings_of_the_format_are_kept(tmp_path):
    street = write_street(tmp_path / "street")
    out = tmp_path / "cut"
    words = ["partition", str(street), f"out={out}", "blocks=2", "datamanager.blank_pixels=0.5"]
    assert main(words) == 0
    assert read_partition(out).settings == {"blank_pixels": 0.5}


def test_a_data_set_that_moved_is_named_with_the_remedy(cut, tmp_path):
    shutil.move(tmp_path / "street", tmp_path / "road")
    with pytest.raises(DataError, match=r"no such file or folder.\n.*datamanager.source=PATH"):
        BlocksConfig().build(DataRequest(cut))
    data = BlocksConfig(source=str(tmp_path / "road")).build(DataRequest(cut))
    assert len(data.views(Split.TRAIN)) == 14
    data.close()


def test_partition_and_data_that_move_together_are_found(cut, tmp_path):
    (tmp_path / "new").mkdir()
    for name in ("street", "cut"):
        shutil.move(tmp_path / name, tmp_path / "new" / name)
    assert read_partition(tmp_path / "new" / "cut").data == (tmp_path / "new" / "street").resolve()


def test_a_data_set_without_some_of_its_views_is_refused(cut, tmp_path):
    file = tmp_path / "street" / "transforms.json"
    document = json.loads(file.read_text())
    document["frames"] = document["frames"][3:]
    file.write_text(json.dumps(document))
    with pytest.raises(DataError, match="has changed: 3 of its views are gone"):
        BlocksConfig().build(DataRequest(cut))


def test_an_unknown_block_is_refused_with_the_known_ones(cut):
    with pytest.raises(DataError, match=r"no block 'b7'\.\nBlocks: b0, b1\."):
        BlocksConfig(block="b7").build(DataRequest(cut))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda d: d.pop("ground"), "ground of its content is missing"),
        (lambda d: d.pop("data_from_here"), "data_from_here of its content is missing"),
        (lambda d: d["ground"].update(axes=[[1, 0, 0]] * 3), "three orthonormal vectors"),
        (lambda d: d["blocks"][0].update(train=[]), "names of at least one view"),
        (lambda d: d["blocks"][0].update(cell={"first_from": "x"}), "one finite number"),
        (lambda d: d["blocks"][0].update(name="../x"), "letters, digits"),
        (lambda d: d.update(blocks=[]), "no blocks"),
        (lambda d: d.update(version=9), "version 9"),
        (lambda d: d.update(format="other"), "'gsfw partition'"),
        (lambda d: d["settings"].update(blank_pixels="much"), "settings.blank_pixels"),
    ],
)
def test_a_damaged_partition_is_refused_in_one_sentence(cut, damage, message):
    document = json.loads((cut / FILE).read_text())
    damage(document)
    (cut / FILE).write_text(json.dumps(document))
    with pytest.raises(DataError, match=message):
        BlocksConfig().build(DataRequest(cut))


def test_a_setting_of_a_partition_out_of_range_is_refused(cut):
    document = json.loads((cut / FILE).read_text())
    document["settings"]["blank_pixels"] = 1.5
    (cut / FILE).write_text(json.dumps(document))
    with pytest.raises(ConfigError, match=r"settings\.blank_pixels=1\.5: expected a number"):
        BlocksConfig().build(DataRequest(cut))


def test_a_partition_that_is_cut_off_or_missing_is_refused(cut, tmp_path):
    (cut / FILE).write_text((cut / FILE).read_text()[:100])
    with pytest.raises(DataError, match="cannot be read"):
        read_partition(cut)
    with pytest.raises(DataError, match="is no partition"):
        read_partition(tmp_path)


def test_coordinates_of_millions_change_nothing_of_what_is_trained_on(tmp_path):
    origin = (2.0**22, -(2.0**21), 2.0**10)  # So that sums are exact in float64.
    blocks = []
    for name, place in (("near", (0.0, 0.0, 0.0)), ("far", origin)):
        write_street(tmp_path / name, origin=place)
        out = tmp_path / f"cut-{name}"
        assert main(["partition", str(tmp_path / name), f"out={out}", "blocks=2"]) == 0
        data = BlocksConfig(block="b0").build(DataRequest(out))
        blocks.append((data.scene, data.views(Split.TRAIN)))
        data.close()
    (near, near_views), (far, far_views) = blocks
    assert near_views.names == far_views.names
    assert near.points.shape == far.points.shape
    # Points and cameras of the far one are rounded to 2^-30 before they are read.
    assert (near.points - far.points).abs().max() < 1e-6
    for one, other in zip(near_views.cameras, far_views.cameras, strict=True):
        assert (one.world_to_camera - other.world_to_camera).abs().max() < 1e-6
    shift = far.world_from_scene.translation - near.world_from_scene.translation
    assert np.allclose(shift, torch.tensor(origin, dtype=torch.float64), atol=1e-8)


@pytest.mark.slow
def test_a_run_far_from_the_origin_shows_the_same_picture(tmp_path):
    shown = []
    for name, place in (("near", (0.0, 0.0, 0.0)), ("far", (4.5e6, -3.1e6, 250.0))):
        write_street(tmp_path / name, origin=place)
        cut, out = tmp_path / f"cut-{name}", tmp_path / f"run-{name}"
        assert main(["partition", str(tmp_path / name), f"out={cut}", "blocks=2"]) == 0
        words = ["method=3dgs", f"data={cut}", "datamanager.block=b0", "steps=8", "report=false"]
        assert main(["train", *words, f"out={out}"]) == 0
        parts = restore(RunFolder(out), installed()).composition.parts
        (batch,) = parts.data.load(Split.TRAIN, [3], parts.device)
        with torch.no_grad():
            found = render_model(parts.model, parts.rasterizer, batch.cameras, RenderSettings())
        shown.append((found.color, json.loads((out / "metrics.json").read_text())["psnr"]))
        parts.data.close()
    (near, near_psnr), (far, far_psnr) = shown
    assert near.std() > 0.01
    # Places are rounded to 1e-9 before they are read, and Adam's first steps are by signs.
    assert -10 * (near - far).square().mean().log10() > 60
    assert abs(near_psnr - far_psnr) < 1e-3
