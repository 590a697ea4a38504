"""The ``transforms`` format."""

import json
import math

import numpy as np
import pytest
import torch
from PIL import Image
from plyfile import PlyData, PlyElement
from support.small_captures import (
    CENTER,
    FOCAL,
    HEIGHT,
    WIDTH,
    builder_of,
    projection_error,
    ring,
    write_image,
    write_images,
    write_transforms,
)

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.transforms import TransformsConfig
from gsfw.datamanagers.transforms_file import TransformsFile

CPU = torch.device("cpu")


@pytest.fixture
def folder(tmp_path):
    """A folder with the images of the ring, which a test adds its transforms.json to."""
    write_images(tmp_path, ring())
    return tmp_path


build = builder_of(TransformsConfig)


def write(folder, frame_settings=(), **settings):
    return write_transforms(folder / "transforms.json", ring(), frame_settings, **settings)


def failure(path) -> DataError:
    with pytest.raises(DataError) as error:
        build(path)
    return error.value


def write_ply(path, columns: dict) -> None:
    values = np.rec.fromarrays(list(columns.values()), names=list(columns))
    PlyData([PlyElement.describe(np.asarray(values), "vertex")]).write(path)


def test_points_fall_where_they_should(folder):
    write(folder)
    assert projection_error(build(folder), ring()) < 0.01
    assert projection_error(build(folder / "transforms.json"), ring()) < 0.01
    assert projection_error(build(folder, downscale=2.0), ring(), scale=0.5) < 0.01


def test_georeferenced_cameras_see_the_same_pixels(folder):
    capture = ring(4, 30.0, origin=(5e6, 4.9e6, 300.0))
    write_transforms(folder / "transforms.json", capture)
    data = build(folder)
    # There are no points in this file, so the world's points go through the frame here.
    assert projection_error(data, capture) < 0.01


def test_camera_angles_give_the_focal_lengths_and_the_centre_is_the_default(folder):
    angles = {
        "camera_angle_x": 2 * math.atan(WIDTH / 2 / FOCAL[0]),
        "camera_angle_y": 2 * math.atan(HEIGHT / 2 / FOCAL[1]),
    }
    write(folder, fl_x=None, fl_y=None, cx=None, cy=None, w=None, h=None, **angles)
    camera = build(folder).views(Split.TRAIN).cameras[0]
    wanted = torch.tensor([[FOCAL[0], 0, WIDTH / 2], [0, FOCAL[1], HEIGHT / 2], [0, 0, 1]])
    torch.testing.assert_close(camera.intrinsics[0], wanted)


def test_one_angle_stands_for_square_pixels(folder):
    write(folder, fl_x=None, fl_y=None, camera_angle_x=1.0)
    intrinsics = build(folder).views(Split.TRAIN).cameras[0].intrinsics[0]
    assert intrinsics[0, 0] == intrinsics[1, 1] == pytest.approx(32 / math.tan(0.5))


def test_settings_of_a_frame_go_before_those_of_the_file(folder):
    settings = [{}, {"camera_angle_x": 1.0, "cx": 30.0}, {}, {}]
    write(folder, settings)
    cameras = build(folder).views(Split.TRAIN).cameras
    assert cameras[0].intrinsics[0, 0, 0] == FOCAL[0]
    assert cameras[1].intrinsics[0, 0, 0] == pytest.approx(32 / math.tan(0.5))
    assert cameras[1].intrinsics[0, 0, 2] == 30.0
    assert [int(camera.camera_index[0]) for camera in cameras] == [0, 1, 0, 0]


def test_cameras_are_those_that_frames_name_where_all_do(folder):
    write(folder, [{"camera_index": index} for index in (1, 0, 2, 1)])
    cameras = build(folder).views(Split.TRAIN).cameras
    assert [int(camera.camera_index[0]) for camera in cameras] == [1, 0, 2, 1]
    write(folder, [{"camera_index": 1}, {}, {}, {}])
    cameras = build(folder).views(Split.TRAIN).cameras
    assert [int(camera.camera_index[0]) for camera in cameras] == [0, 0, 0, 0]


@pytest.mark.parametrize("index", [-1, 0.5, "left", True, None, 10**30])
def test_camera_indices_that_count_nothing_are_refused(folder, index):
    write(folder, [{"camera_index": index}, {}, {}, {}])
    with pytest.raises(DataError) as error:
        build(folder)
    shown = "nothing" if index is None else repr(index)
    assert error.value.message == (
        f"{folder}/transforms.json: frame view_000.png: camera_index: expected the camera's "
        f"number from 0 on, or no camera_index at all, found {shown}."
    )


def test_points_of_a_ply_come_along_with_their_colours(folder):
    capture = ring()
    columns = dict(zip("xyz", capture.points.astype(np.float32).T, strict=True))
    columns |= dict(zip(("red", "green", "blue"), capture.colors.T, strict=True))
    write_ply(folder / "sparse_pc.ply", columns)
    write(folder, ply_file_path="sparse_pc.ply")
    scene = build(folder).scene
    world = scene.world_from_scene.apply(scene.points)
    torch.testing.assert_close(world, torch.from_numpy(capture.points), atol=1e-6, rtol=0)
    assert np.allclose(scene.point_colors.numpy(), capture.colors / 255)


def test_points_without_colours_are_grey(folder):
    write_ply(folder / "points.ply", {name: np.zeros(2, np.float32) for name in "xyz"})
    write(folder, ply_file_path="./points.ply")
    assert build(folder).scene.point_colors.tolist() == [[0.5] * 3] * 2


@pytest.mark.parametrize("name", ["sparse_pc.ply", "x" * 5000])
def test_points_that_are_not_on_disk_are_noted(folder, name):
    write(folder, ply_file_path=name)
    data = build(folder)
    assert data.scene.points.shape == (0, 3)
    assert f"its points (ply_file_path {name}) are not on disk" in data.notes()


def test_broken_points_name_their_file(folder):
    write(folder, ply_file_path="points.ply")
    (folder / "points.ply").write_text("ply\nformat ascii 1.0\nelement vertex 9\n")
    assert str(failure(folder)) == (
        f"{folder}/points.ply is a damaged PLY: its header does not end.\n"
        "Expected a PLY with x, y, z; remove ply_file_path to train without points."
    )
    write_ply(folder / "points.ply", {name: np.full(2, np.nan, np.float32) for name in "xyz"})
    assert str(failure(folder)) == (
        f"{folder}/points.ply: some of its points are not finite.\nRemove them."
    )


def test_masks_tell_which_pixels_are_valid(folder):
    values = np.zeros((HEIGHT, WIDTH), np.uint8)
    values[:, : WIDTH // 2] = 255
    Image.fromarray(values).save(folder / "mask.png")
    write(folder, [{"mask_path": "mask.png"}, {}, {}, {}])
    (batch,) = build(folder, downscale=2.0).load(Split.TRAIN, [0, 1], CPU)
    assert batch.valid is not None
    assert batch.valid[0, :, :, 0].float().mean(0).tolist() == [1.0] * 16 + [0.0] * 16
    assert batch.valid[1].all()


def test_a_missing_mask_names_its_frame(folder):
    path = write(folder, [{"mask_path": "mask.png"}, {}, {}, {}])
    assert str(failure(folder)) == (
        f"{path}: frame view_000.png: its mask mask.png is not on disk.\n"
        "Put it there, or remove mask_path to use every pixel."
    )


def test_the_own_split_of_the_file_is_kept(folder):
    names = ring().names
    write(folder, train_filenames=names[1:3], test_filenames=["./" + names[0]])
    data = build(folder, eval_every_nth=2)
    assert data.views(Split.TRAIN).names == tuple(names[1:3])
    assert data.views(Split.EVAL).names == (names[0],)
    assert data.notes()[-2:] == (
        "1 frames are neither in train_filenames nor in test_filenames: left out",
        "held-out views: the data set's own split",
    )


def test_lists_that_name_no_frame_are_refused(folder):
    path = write(folder, train_filenames=["a.png"], test_filenames=["b.png"])
    assert str(failure(folder)) == (
        f"{path}: none of its frames is in train_filenames or test_filenames.\n"
        "Write the names there as in file_path, or remove both lists."
    )


@pytest.mark.parametrize("key", ["test_filenames", "val_filenames"])
def test_frames_outside_the_only_list_make_up_the_other_split(folder, key):
    names = ring().names
    write(folder, **{key: names[:1]})
    assert build(folder).views(Split.TRAIN).names == tuple(names[1:])
    write(folder, train_filenames=names[:3])
    assert build(folder).views(Split.EVAL).names == (names[3],)


def test_times_are_normalised_and_their_range_is_kept(folder):
    write(folder, [{"time": time} for time in (2.0, 6.0, 2.0, 3.0)])
    data = build(folder)
    assert data.views(Split.TRAIN).times == (0.0, 1.0, 0.0, 0.25)
    assert (data.scene.time_range, data.scene.num_times) == ((2.0, 6.0), 3)
    batches = data.load(Split.TRAIN, [0, 1, 2], CPU)
    assert [(batch.views, float(batch.time)) for batch in batches] == [((0, 2), 0.0), ((1,), 1.0)]


@pytest.mark.parametrize(
    ("pose", "expected"),
    [
        (None, ": expected 3 x 4 or 4 x 4 finite numbers, found nothing."),
        ([[1, 2], [3, 4]], ": expected 3 x 4 or 4 x 4 finite numbers, found [[1, 2], [3, 4]]."),
        ("none", ": expected 3 x 4 or 4 x 4 finite numbers, found 'none'."),
        ([[1, 2]] * 3, "[0]: expected 4 finite numbers, found [1, 2]."),
        ([[1, 2, 3, "x"]] * 4, "[0][3]: expected one finite number, found 'x'."),
        ([[1, 2, 3, np.nan]] * 4, "[0][3]: expected one finite number, found nan."),
        ([[1.25] * 4] * 2 + [[1.25, -np.inf] * 2], "[2][1]: expected one finite number, found -i"),
    ],
)
def test_a_frame_without_a_pose_is_named_with_what_is_wrong(folder, pose, expected):
    path = write(folder, [{"transform_matrix": pose}, {}, {}, {}])
    said = str(failure(folder))
    assert said.startswith(f"{path}: frame view_000.png: transform_matrix{expected}")


FISHEYE = {"camera_model": "OPENCV_FISHEYE", "k1": 0.02, "k2": -0.01}


@pytest.mark.parametrize(
    ("settings", "model", "distortion"),
    [
        ({"k1": 0.1, "p2": -0.02}, "OPENCV", (0.1, 0.0, 0.0, -0.02)),
        ({"camera_model": "SIMPLE_RADIAL", "k1": 0.1}, "OPENCV", (0.1, 0.0, 0.0, 0.0)),
        ({"camera_model": "OPENCV", "k1": 0.1, "k3": 0.2}, "FULL_OPENCV", (0.1, 0, 0, 0, 0.2)),
        ({"k4": 0.3, "k6": 0.1}, "FULL_OPENCV", (0, 0, 0, 0, 0, 0.3, 0, 0.1)),
        ({"camera_model": "FULL_OPENCV", "k4": 0.3}, "FULL_OPENCV", (0, 0, 0, 0, 0, 0.3)),
        (FISHEYE, "OPENCV_FISHEYE", (0.02, -0.01)),
        ({"is_fisheye": True, "k4": 0.01}, "OPENCV_FISHEYE", (0, 0, 0, 0.01)),
        ({"camera_model": "RADIAL_FISHEYE", "k2": 0.1}, "OPENCV_FISHEYE", (0, 0.1)),
        ({"camera_model": "FOV", "omega": 0.9}, "FOV", (0.9,)),
        ({"k1": 0.0, "k4": 0, "camera_model": "SIMPLE_PINHOLE"}, "PINHOLE", ()),
    ],
)
def test_coefficients_are_read_as_their_model_has_them(folder, settings, model, distortion):
    path = write(folder, **settings)
    frames, _ = TransformsFile.read(path).frames()
    lens = frames[0].lens
    assert lens.model == model
    missing = len(lens.distortion) - len(distortion)
    assert lens.distortion == (*distortion, *[0.0] * missing)


def test_distorted_images_come_undistorted_and_cameras_follow(folder):
    write(folder, [{}, {"k1": -0.1}, FISHEYE, {"fl_x": 60.0, "fl_y": 60.0, "k1": 0.1}])
    data = build(folder)
    cameras = data.views(Split.TRAIN).cameras
    sizes = [(camera.width, camera.height) for camera in cameras]
    assert sizes[0] == (WIDTH, HEIGHT)
    assert len(set(sizes)) == 4
    assert cameras[3].intrinsics[0, 0, 0] == 60.0
    for index, size in enumerate(sizes):
        (batch,) = data.load(Split.TRAIN, [index], CPU)
        assert batch.images.shape[1:3] == size[::-1]
        assert batch.mask is None
    assert [note for note in data.notes() if "undistorted from OPENCV_FISHEYE to PINHOLE" in note]


def test_masks_and_alpha_of_distorted_images_come_along(folder):
    values = np.zeros((HEIGHT, WIDTH), np.uint8)
    values[:, : WIDTH // 2] = 255
    Image.fromarray(values).save(folder / "mask.png")
    write_image(folder / "view_000.png", mode="RGBA")
    masks = {"mask_path": "mask.png", "motion_mask_path": "mask.png"}
    write(folder, [masks, {}, {}, {}], k1=-0.1)
    data = build(folder)
    (batch,) = data.load(Split.TRAIN, [0, 1], CPU)
    height, width = batch.images.shape[1:3]
    assert batch.alpha is not None
    assert batch.mask is not None
    assert batch.mask[0, :, : width // 2 - 4].all()
    assert not batch.mask[0, :, width // 2 + 4 :].any()
    assert batch.mask[1].all()
    moving = data.moving_mask(Split.TRAIN, 0)
    assert moving is not None
    assert moving.shape == (height, width, 1)
    assert moving[:, : width // 2 - 4].all()
    assert not moving[:, width // 2 + 4 :].any()


def test_a_coefficient_that_its_model_lacks_is_named(folder):
    path = write(folder, k1=0.1, k4=0.2)
    assert str(failure(folder)) == (
        f"{path}: frame view_000.png: k4=0.2 has no meaning for camera_model=OPENCV, which has "
        "k1, k2, p1, p2.\n"
        "Remove it, or name the model it belongs to (FULL_OPENCV has k1 to k6, p1 and p2)."
    )


@pytest.mark.parametrize("model", ["EQUIRECTANGULAR", 3, ["OPENCV"]])
def test_a_camera_model_that_is_none_is_refused(folder, model):
    path = write(folder, [{"camera_model": model}, {}, {}, {}])
    assert str(failure(folder)).startswith(
        f"{path}: frame view_000.png: cameras of camera_model={model} cannot be used.\n"
        "Expected one of SIMPLE_PINHOLE, PINHOLE, "
    )


def test_a_distortion_of_zero_is_a_pinhole(folder):
    write(folder, k1=0.0, k2=0, p1=0.0, camera_model="OPENCV", is_fisheye=False)
    assert projection_error(build(folder), ring()) < 0.01


def test_a_camera_without_focal_length_says_what_would_give_one(folder):
    path = write(folder, fl_x=None, fl_y=None)
    assert str(failure(folder)) == (
        f"{path}: frame view_000.png: there is no focal length.\n"
        "Expected one of fl_x, fl_y, camera_angle_x, camera_angle_y, for the file or for the frame."
    )


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"fl_x": "70"}, "fl_x: expected one finite number, found '70'."),
        ({"cx": float("inf")}, "cx: expected one finite number, found inf."),
        ({"cx": 10**400}, f"cx: expected one finite number, found {10**56}...."),
        (
            {"fl_x": None, "camera_angle_x": 40.0},
            "camera_angle_x: expected radians between 0 and pi, found 40.0.",
        ),
    ],
)
def test_a_setting_that_is_no_number_is_named(folder, settings, message):
    path = write(folder, **settings)
    assert str(failure(folder)).startswith(f"{path}: frame view_000.png: {message}\n")


def test_an_image_of_another_size_is_refused_with_both_sizes(folder):
    path = write(folder, w=WIDTH + 2)
    assert failure(folder).message == (
        f"{folder}/view_000.png is 64x48 pixels, but {path} describes 66x48."
    )


def test_a_file_that_is_cut_off_is_refused(folder):
    path = write(folder)
    path.write_text(path.read_text()[:100])
    assert str(failure(folder)).startswith(f"{path} cannot be read as JSON: ")


@pytest.mark.parametrize("content", [[], {}, {"frames": {}}, {"frames": ["a.png"]}])
def test_a_file_of_another_kind_is_refused(folder, content):
    path = folder / "transforms.json"
    path.write_text(json.dumps(content))
    assert str(failure(folder)) == (
        f"{path} has no list of frames.\n"
        'Expected {"frames": [{"file_path": ..., "transform_matrix": ...}, ...]}.'
    )


def test_empty_frames_and_frames_without_a_path_are_refused(folder):
    path = folder / "transforms.json"
    path.write_text('{"frames": []}')
    correct = "Correct the value, or export the file again."
    assert str(failure(folder)) == f"{path}: its list of frames is empty.\n{correct}"
    for frame, wrong in (
        ("{}", " is missing; expected text."),
        ('{"file_path": 3}', ": expected text, found 3."),
        ('{"file_path": ""}', ": expected the path of an image, found ''."),
    ):
        path.write_text(f'{{"frames": [{frame}]}}')
        said = f"{path}: frame 0 (counted from 0): file_path{wrong}\n{correct}"
        assert str(failure(folder)) == said


def test_a_list_of_names_has_to_be_one(folder):
    path = write(folder, train_filenames=[1, 2])
    said = f"{path}: train_filenames: expected a list of texts, found [1, 2]."
    assert failure(folder).message == said


def test_a_folder_without_the_file_is_refused(tmp_path):
    assert str(failure(tmp_path)) == (
        f"{tmp_path} contains no transforms.json.\nGive the folder that contains it, or the file."
    )


def test_principal_point_and_focal_lengths_are_those_of_the_file(folder):
    write(folder)
    intrinsics = build(folder).views(Split.TRAIN).cameras[0].intrinsics[0]
    wanted = [[FOCAL[0], 0.0, CENTER[0]], [0.0, FOCAL[1], CENTER[1]], [0.0, 0.0, 1.0]]
    assert intrinsics.tolist() == wanted
