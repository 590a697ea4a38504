"""Data sets of every format, converted and loaded again."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image
from plyfile import PlyData
from support.captures import (
    blender,
    colmap_per_frame,
    llff,
    metashape,
    nerfies,
    openmvg,
    opensfm,
    panoptic,
    polycam,
    reality_capture,
    record3d,
    synchronised_videos,
)
from support.sampling import sampled
from support.small_captures import (
    HEIGHT,
    WIDTH,
    SmallCapture,
    request,
    ring,
    write_colmap,
    write_images,
    write_transforms,
)
from support.small_videos import cameras

from gsfw.core.datamanager import Split
from gsfw.core.errors import OutputError
from gsfw.datamanagers.blender import BlenderConfig
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.datamanagers.colmap.per_frame import ColmapPerFrameConfig
from gsfw.datamanagers.llff import LlffConfig
from gsfw.datamanagers.map_file import DEPTH
from gsfw.datamanagers.masks import MaskRule
from gsfw.datamanagers.metashape import MetashapeConfig
from gsfw.datamanagers.nerfies import NerfiesConfig
from gsfw.datamanagers.neural_3d_video import Neural3DVideoConfig
from gsfw.datamanagers.openmvg import OpenMvgConfig
from gsfw.datamanagers.opensfm import OpenSfmConfig
from gsfw.datamanagers.panoptic import PanopticConfig
from gsfw.datamanagers.polycam import PolycamConfig
from gsfw.datamanagers.reality_capture import RealityCaptureConfig
from gsfw.datamanagers.record3d import Record3dConfig
from gsfw.datamanagers.synchronised_videos import SynchronisedVideosConfig
from gsfw.datamanagers.transforms import TransformsConfig
from gsfw.preparation.writing.conversion import ConversionRule, convert
from gsfw.preparation.writing.image_output import OutputRule

CPU = torch.device("cpu")
LAYOUTS = {"colmap": ColmapConfig, "transforms": TransformsConfig}
BROWN = {"camera_model": "OPENCV", "k1": -0.12, "k2": 0.03, "p1": 0.004, "p2": -0.003}


def colmap(folder, **camera):
    write_images(folder / "images", ring())
    write_colmap(folder / "sparse/0", ring(), **camera)
    return ColmapConfig().build(request(folder))


def transforms(folder, capture=None, **settings):
    write_images(folder, capture or ring())
    write_transforms(folder / "transforms.json", capture or ring(), **settings)
    return TransformsConfig(depth=True).build(request(folder))


def made(config, write, *arguments, **settings):
    """A loaded data set of a format."""
    return lambda folder: config.build(request(write(folder, *arguments, **settings)))


STILL = {
    "colmap": colmap,
    "transforms": transforms,
    "blender": made(BlenderConfig("test"), blender.write),
    "llff": made(LlffConfig(), llff.write, llff.centred(ring())),
    "metashape": made(MetashapeConfig(), metashape.write),
    "reality-capture": made(RealityCaptureConfig(), reality_capture.write),
    "polycam": made(PolycamConfig(), polycam.write),
    "record3d": made(Record3dConfig(), record3d.write),
    "opensfm": made(OpenSfmConfig(), opensfm.write),
    "openmvg": made(OpenMvgConfig(), openmvg.write),
}
MOVING = {
    "dnerf": made(BlenderConfig("val"), blender.dnerf),
    "nerfies": made(NerfiesConfig(), nerfies.write, scales=(1,)),
    "panoptic": made(PanopticConfig(), panoptic.write),
    "neural-3d-video": made(Neural3DVideoConfig(), llff.write_folders, llff.centred(cameras())),
    "colmap-per-frame": made(ColmapPerFrameConfig(), colmap_per_frame.write),
    "synchronised-videos": made(SynchronisedVideosConfig(), synchronised_videos.write),
}


def again(data, out, **rule):
    """A loaded data set, converted and loaded again, and what the conversion says."""
    found = convert(data.recording, out, ConversionRule(**rule))
    config = LAYOUTS[found.layout]()
    if found.layout == "transforms":
        config = TransformsConfig(depth=True)
    return config.build(request(out)), found


def by_name(data):
    return sorted(data.recording.frames, key=lambda frame: frame.name)


def check_frames(before, after):
    """Check that cameras are where they were in the world, and see rays where they did."""
    slopes = np.random.default_rng(3).uniform(-0.3, 0.3, (20, 2))
    for old, new in zip(by_name(before), by_name(after), strict=True):
        pose = old.world_to_camera
        assert torch.allclose(new.world_to_camera, pose, rtol=0, atol=1e-9)
        lens = old.lens.resized(old.header.width, old.header.height)
        assert np.abs(new.lens.project(slopes) - lens.project(slopes)).max() < 1e-9
        assert (new.lens.width, new.lens.height) == (lens.width, lens.height)


def pixels(data):
    """Every image and depth map as training gets it, by the order of names."""
    found = {}
    for split in Split:
        views = data.views(split)
        for number, name in enumerate(views.names):
            (batch,) = data.load(split, [number], CPU)
            depth = batch.maps.get(DEPTH)  # Other maps are not written; a note names them.
            maps = [] if depth is None else [depth.values, depth.known]
            parts = [batch.images, batch.valid, batch.alpha, *maps]
            found[name] = [part for part in parts if part is not None]
    return [found[name] for name in sorted(found)]


def check_pixels(before, after, tolerance=0.0):
    for old, new in zip(pixels(before), pixels(after), strict=True):
        for one, other in zip(old, new, strict=True):
            assert one.shape == other.shape
            assert float((one.float() - other.float()).abs().max()) <= tolerance


def splits(data):
    return [frame.split for frame in by_name(data)]


@pytest.mark.parametrize("name", STILL)
def test_what_stands_still_comes_back_from_a_colmap_model(tmp_path, name):
    before = STILL[name](tmp_path / "given")
    after, found = again(before, tmp_path / "out")
    assert found.layout == "colmap"
    check_frames(before, after)
    check_pixels(before, after)
    assert torch.allclose(after.recording.points, before.recording.points, rtol=0, atol=1e-9)
    assert torch.allclose(after.recording.point_colors, before.recording.point_colors, atol=2e-3)
    cameras_before = [frame.camera for frame in by_name(before)]
    assert [frame.camera for frame in by_name(after)] == cameras_before


@pytest.mark.parametrize(
    "name", sampled([(name,) for name in STILL | MOVING], daily=range(0, 15, 3))
)
def test_every_format_comes_back_from_a_transforms_file(tmp_path, name):
    before = (STILL | MOVING)[name](tmp_path / "given")
    after, found = again(before, tmp_path / "out", layout="transforms")
    check_frames(before, after)
    # Images of videos become JPEG files.
    check_pixels(before, after, 0.05 if name == "synchronised-videos" else 0.0)
    assert torch.allclose(after.recording.points, before.recording.points, rtol=0, atol=1e-9)
    times = [frame.time for frame in by_name(before)]
    assert [frame.time for frame in by_name(after)] == times
    held = [split is Split.EVAL for split in splits(before)]
    assert [split is Split.EVAL for split in splits(after)] == held
    assert (splits(after)[0] is None) == (splits(before)[0] is None)
    assert found.images == len(times)


@pytest.mark.parametrize("name", MOVING)
def test_what_moves_goes_to_a_transforms_file_by_itself(tmp_path, name):
    before = MOVING[name](tmp_path / "given")
    after, found = again(before, tmp_path / "out")
    assert found.layout == "transforms"
    assert after.scene.is_dynamic
    if name != "dnerf":
        assert after.scene.time_range == before.scene.time_range
        assert after.scene.num_times == before.scene.num_times


def test_images_of_videos_become_files(tmp_path):
    before = MOVING["synchronised-videos"](tmp_path / "given")
    after, found = again(before, tmp_path / "out")
    frame = by_name(after)[0]
    assert (frame.name, frame.shot) == ("images/cam00/000000.jpg", None)
    count = len(after.recording.frames)
    assert f"{count} images of 3 videos are JPEG files now" in found.notes


def test_what_moves_is_still_marked(tmp_path):
    before = MOVING["panoptic"](tmp_path / "given")
    after, _ = again(before, tmp_path / "out")
    assert torch.equal(after.moving_mask(Split.EVAL, 0), before.moving_mask(Split.EVAL, 0))


def masked(folder, **settings):
    inside = np.zeros((HEIGHT, WIDTH), np.uint8)
    inside[8:40, 8:56] = 255
    (folder / "masks").mkdir(parents=True)
    for name in ring().names:
        Image.fromarray(inside).save(folder / "masks" / name)
    return transforms(folder, **settings)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_masks_come_along(tmp_path, layout):
    before = masked(tmp_path / "given")
    after, found = again(before, tmp_path / "out", layout=layout)
    check_pixels(before, after)
    assert found.masks == 4
    assert (tmp_path / "out/masks/view_000.png.png").is_file()


def test_inverted_masks_are_written_bright_where_pixels_count(tmp_path):
    before = masked(tmp_path / "given")
    after, _ = again(before, tmp_path / "out", masks=MaskRule(inverted=True))
    (batch,) = after.load(Split.TRAIN, [0], CPU)
    assert not batch.valid[0, 20, 30].any()
    assert batch.valid[0, 0, 0].all()


@pytest.mark.parametrize("layout", LAYOUTS)
def test_masks_are_undistorted_with_their_images(tmp_path, layout):
    before = masked(tmp_path / "given", **BROWN)
    after, _ = again(before, tmp_path / "out", layout=layout, output=OutputRule("pinhole"))
    assert by_name(after)[0].lens.model == "PINHOLE"
    check_pixels(before, after)


@pytest.mark.parametrize("lens", ["keep", "pinhole"])
def test_depths_come_along(tmp_path, lens):
    depths = np.full((HEIGHT, WIDTH), 1500, np.uint16)
    depths[:, :20] = 0
    (tmp_path / "given").mkdir()
    Image.fromarray(depths).save(tmp_path / "given/depth.png")
    own = [{"depth_file_path": "depth.png"}, {}, {}, {}]
    before = transforms(
        tmp_path / "given", frame_settings=own, depth_unit_scale_factor=0.002, **BROWN
    )
    after, found = again(before, tmp_path / "out", output=OutputRule(lens))
    assert found.layout == "transforms"
    check_pixels(before, after, 1e-6)
    assert by_name(after)[0].maps["depth"].unit == 0.002
    assert by_name(after)[1].maps == {}


def test_a_distorted_data_set_is_undistorted_as_training_does_it(tmp_path):
    params = (70.0, 72.0, 31.0, 25.0, -0.12, 0.03, 0.004, -0.003)
    before = colmap(tmp_path / "given", model="OPENCV", params=params)
    after, found = again(before, tmp_path / "out", output=OutputRule("pinhole"))
    check_pixels(before, after)
    for old, new in zip(
        *(data.views(Split.TRAIN).cameras for data in (before, after)), strict=True
    ):
        assert torch.allclose(new.intrinsics, old.intrinsics, atol=1e-4)
    assert found.sizes == ((after.recording.frames[0].header.width, found.sizes[0][1]),)
    assert found.lens.startswith("PINHOLE, undistorted from OPENCV (up to ")


def test_alpha_stays(tmp_path):
    before = STILL["blender"](tmp_path / "given")
    after, _ = again(before, tmp_path / "out")
    (batch,) = after.load(Split.TRAIN, [0], CPU)
    assert batch.alpha is not None


def test_a_split_that_colmap_cannot_hold_is_listed_and_named(tmp_path):
    before = STILL["blender"](tmp_path / "given")
    out = tmp_path / "out"
    _, found = again(before, out)
    assert (out / "sparse/0/test.txt").read_text() == "test/r_3.png\n"
    assert found.notes == (
        "the world stays as it was, with z upwards; readers of this layout take -y to be up",
        "a COLMAP model cannot say what is held out (1 of 4 images, listed in "
        "sparse/0/test.txt): train with holdout=test/r_3.png, or use layout=transforms",
    )
    held = ColmapConfig().build(request(out, eval_names=("test/r_3.png",)))
    assert held.views(Split.EVAL).names == ("test/r_3.png",)


def test_many_held_out_images_are_named_by_a_command(tmp_path):
    data = transforms(tmp_path / "given", replace(ring(8)))
    frames = [
        replace(frame, split=Split.TRAIN if number < 1 else Split.EVAL)
        for number, frame in enumerate(data.recording.frames)
    ]
    out = tmp_path / "out"
    found = convert(replace(data.recording, frames=tuple(frames)), out, ConversionRule())
    command = f'train with holdout="$(paste -sd, {out}/sparse/0/test.txt)", or use'
    assert command in found.notes[-1]


def test_times_that_colmap_cannot_hold_are_noted(tmp_path):
    before = MOVING["dnerf"](tmp_path / "given")
    _, found = again(before, tmp_path / "out", layout="colmap")
    assert (
        "a COLMAP model cannot hold times, which 4 images have: use layout=transforms to keep them"
    ) in found.notes


def test_points_without_tracks_are_noted(tmp_path):
    _, found = again(colmap(tmp_path / "given"), tmp_path / "out")
    assert found.notes == (
        "points have no tracks (which images saw them): gsfw needs none, other programs may",
    )


def test_times_of_images_that_are_left_out_are_noted(tmp_path):
    times = [0, 1, 2, 3, 4, 0]
    write = made(BlenderConfig("test"), blender.write, ("train", "test", "val"), times)
    before = write(tmp_path / "given")
    _, found = again(before, tmp_path / "out")
    assert (
        "times go from 0 to 3 now, as images from 0 to 4 that were neither trained nor evaluated "
        "on are left out"
    ) in found.notes


def test_points_lose_their_times_with_a_note(tmp_path):
    before = MOVING["colmap-per-frame"](tmp_path / "given")
    _, found = again(before, tmp_path / "out")
    assert "points have no times any more: all of them are there from the beginning" in found.notes


def test_cameras_that_only_the_data_set_told_apart_stay_apart(tmp_path):
    before = MOVING["nerfies"](tmp_path / "given")
    after, _ = again(before, tmp_path / "out")
    numbers = [
        [frame.camera for frame in sorted(data.recording.frames, key=lambda frame: frame.time)]
        for data in (before, after)
    ]
    assert numbers[0] == numbers[1]
    assert set(numbers[0]) == {0, 1}


def test_names_that_lead_elsewhere_or_lack_a_suffix_become_names_below_images(tmp_path):
    capture: SmallCapture = ring()
    (tmp_path / "given/inner").mkdir(parents=True)
    write_images(tmp_path / "given", capture)
    names = [f"../{name.removesuffix('.png')}" for name in capture.names]
    path = write_transforms(tmp_path / "given/inner/transforms.json", replace(capture, names=names))
    before = TransformsConfig().build(request(path.parent))
    after, _ = again(before, tmp_path / "out")
    assert [frame.name for frame in by_name(after)] == capture.names


def test_a_second_conversion_leaves_nothing_of_the_first(tmp_path):
    before = masked(tmp_path / "given")
    again(before, tmp_path / "out", layout="transforms")
    other = transforms(tmp_path / "other", ring(3))
    again(other, tmp_path / "out", layout="colmap")
    files = {
        item.relative_to(tmp_path / "out").as_posix() for item in (tmp_path / "out").rglob("*")
    }
    assert {name for name in files if "." in name and not name.endswith(".bin")} == {
        *(f"images/{name}" for name in ring(3).names),
        "work/written.txt",
    }


def test_images_are_never_written_over(tmp_path):
    before = colmap(tmp_path)
    with pytest.raises(OutputError) as error:
        convert(before.recording, tmp_path, ConversionRule())
    assert str(error.value) == (
        f"{tmp_path}/images/view_000.png is one of the images that are read, and would be "
        "written over.\nChoose another place with out=DIR."
    )
    assert (tmp_path / "sparse/0/cameras.bin").is_file()


def test_points_are_a_ply_that_other_programs_read(tmp_path):
    before = colmap(tmp_path / "given")
    again(before, tmp_path / "out", layout="transforms")
    vertices = PlyData.read(tmp_path / "out/points.ply")["vertex"]
    assert vertices.data.dtype.names == ("x", "y", "z", "red", "green", "blue")
    assert np.array_equal(vertices["y"], ring().points[:, 1])
