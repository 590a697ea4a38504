"""Data sets of estimated cameras: images, models and tracks that fit together."""

import errno
import io
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
import torch
from PIL import Image, ImageCms
from PIL.ExifTags import Base
from support.distorted_images import HEIGHT, WIDTH, lens, parameters
from support.small_captures import request, ring

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError, OutputError
from gsfw.core.progress import shown_by
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.datamanagers.colmap.reader import read_model
from gsfw.datamanagers.images import read_header
from gsfw.datamanagers.transforms import TransformsConfig
from gsfw.datamanagers.undistortion import LensRule
from gsfw.preparation.exif import Exif
from gsfw.preparation.image_set import ImageSet, SourceImage
from gsfw.preparation.writing.camera_plan import CameraPlan
from gsfw.preparation.writing.data_set import write_data_set
from gsfw.preparation.writing.image_output import OutputRule
from gsfw.preparation.writing.written_files import is_all_there

CPU = torch.device("cpu")
KEEP = OutputRule("keep")
MODELS = ("SIMPLE_RADIAL", "OPENCV", "OPENCV_FISHEYE")
VIEWS = 4
PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def image(number: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """Red tells the column, green the row, so that mixed colours tell a position."""
    pixels = np.zeros((height, width, 3), np.uint8)
    pixels[..., 0], pixels[..., 1] = np.arange(width), np.arange(height)[:, None]
    pixels[..., 2] = 50 * number
    return pixels


def points() -> np.ndarray:
    """Around the middle of the ring, up to what the corners of images show."""
    return 1.7 * ring(VIEWS).points


CORNER = [[1.0, 1.0]]


def estimate(camera, names=None) -> pycolmap.Reconstruction:
    """Exact cameras of one lens and exact observations; each image has one more, of no point."""
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(
            camera_id=1,
            model=camera.model,
            width=camera.width,
            height=camera.height,
            params=parameters(camera),
        )
    )
    tracks = [[] for _ in points()]
    for view, pose in enumerate(ring(VIEWS).poses):
        local = points() @ pose[:3, :3].T + pose[:3, 3]
        seen = camera.project(local[:, :2] / local[:, 2:])
        inside = ((seen > 0) & (seen < (camera.width, camera.height))).all(axis=1)
        for place, point in enumerate(np.flatnonzero(inside)):
            tracks[point].append(pycolmap.TrackElement(view + 1, place))
        name = names[view] if names else f"view_{view}.png"
        image = pycolmap.Image(name, np.concatenate([seen[inside], CORNER]), 1, view + 1)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose[:3]))
    for number, (place, track) in enumerate(zip(points(), tracks, strict=True)):
        point = pycolmap.Point3D()
        point.xyz, point.track = place, pycolmap.Track(track)
        model.add_point3D_with_id(10 + number, point)
    return model


def photos(folder: Path, names=None, **settings) -> ImageSet:
    """The images of an estimate, as files."""
    taken = []
    for view in range(VIEWS):
        name = names[view] if names else f"view_{view}.png"
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(image(view)).save(path, **settings)
        taken.append(SourceImage(name, path, read_header(path), Exif()))
    return ImageSet(tuple(taken))


def loaded(out: Path):
    return ColmapConfig().build(request(out))


def frames(data):
    return data.recording.frames


def images(data) -> list[torch.Tensor]:
    return [data.load(Split.TRAIN, [view], CPU)[0].images[0] for view in range(VIEWS)]


def check_tracks(model: pycolmap.Reconstruction) -> None:
    """Check that images and tracks name each other."""
    assert model.is_valid()
    named = 0
    for number, point in model.points3D.items():
        assert point.track.length() >= 2
        for element in point.track.elements:
            seen = model.images[element.image_id].points2D[element.point2D_idx]
            assert seen.point3D_id == number
            named += 1
    has_point = [p.has_point3D() for image in model.images.values() for p in image.points2D]
    assert sum(has_point) == named


@pytest.mark.parametrize("model", MODELS)
def test_undistorted_data_sets_are_what_training_makes_of_distorted_ones(tmp_path, model):
    taken = photos(tmp_path / "photos")
    estimated = estimate(lens(model))
    write_data_set(estimated, taken, tmp_path / "pinhole", OutputRule())
    write_data_set(estimated, taken, tmp_path / "keep", KEEP)
    flat, bent = loaded(tmp_path / "pinhole"), loaded(tmp_path / "keep")
    assert {frame.lens.model for frame in frames(flat)} == {"PINHOLE"}
    assert {frame.lens.model for frame in frames(bent)} == {model}
    cameras = zip(flat.views(Split.TRAIN).cameras, bent.views(Split.TRAIN).cameras, strict=True)
    for one, other in cameras:
        assert torch.allclose(one.world_to_camera, other.world_to_camera, atol=1e-6)
        assert torch.allclose(one.intrinsics, other.intrinsics, atol=1e-4)
    for one, other in zip(images(flat), images(bent), strict=True):
        assert torch.equal(one, other)


@pytest.mark.parametrize("model", MODELS)
def test_points_land_on_their_moved_observations(tmp_path, model):
    taken = photos(tmp_path / "photos")
    found = write_data_set(estimate(lens(model)), taken, tmp_path, OutputRule())
    written = pycolmap.Reconstruction(tmp_path / "sparse/0")
    check_tracks(written)
    assert (found.images, found.points) == (VIEWS, written.num_points3D())
    seen = 0
    for image in written.images.values():
        for observation in image.get_observation_points2D():
            place = image.project_point(written.points3D[observation.point3D_id].xyz)
            assert np.abs(place - observation.xy).max() < 0.01
            seen += 1
    assert seen > 40
    assert all(point.error < 0.01 for point in written.points3D.values())


def test_what_falls_outside_leaves_the_tracks(tmp_path):
    estimated = estimate(lens("OPENCV_FISHEYE"))
    corners = [
        pycolmap.TrackElement(view, estimated.images[view].num_points2D() - 1) for view in (1, 2)
    ]
    lost = estimated.add_point3D([0.0, 0.0, 0.0], pycolmap.Track(corners))
    taken = photos(tmp_path / "photos")
    found = write_data_set(estimated, taken, tmp_path / "out", OutputRule())
    written = pycolmap.Reconstruction(tmp_path / "out/sparse/0")
    check_tracks(written)
    assert lost not in written.points3D
    assert set(written.points3D) < set(estimated.points3D)
    for image in written.images.values():
        places = np.array([p.xy for p in image.points2D])
        assert (places >= 0).all()
        assert (places <= found.sizes[0]).all()
    gone = estimated.num_points3D() - written.num_points3D()
    assert found.notes == (
        f"{gone} points, which fewer than two undistorted images show, are left out",
    )


@pytest.mark.parametrize("rule", [OutputRule(), KEEP], ids=["pinhole", "keep"])
def test_points_have_the_mean_colour_of_where_they_were_seen(tmp_path, rule):
    estimated = estimate(lens("OPENCV"))
    write_data_set(estimated, photos(tmp_path / "photos"), tmp_path, rule)
    written = pycolmap.Reconstruction(tmp_path / "sparse/0")
    for number, point in written.points3D.items():
        colors = []
        for element in estimated.points3D[number].track.elements:
            x, y = estimated.images[element.image_id].points2D[element.point2D_idx].xy - 0.5
            last = (WIDTH - 1, HEIGHT - 1)
            colors.append([*np.clip([x, y], 0, last), 50 * (element.image_id - 1)])
        assert np.abs(point.color - np.mean(colors, axis=0)).max() <= 0.5 + 1e-9


def test_images_of_pinholes_are_copied(tmp_path):
    taken = photos(tmp_path / "photos")
    for model, distortion in (
        ("PINHOLE", ()),
        ("SIMPLE_PINHOLE", ()),
        ("OPENCV", (1e-5, 0.0, 0.0, 0.0)),
    ):
        out = tmp_path / model
        found = write_data_set(estimate(lens(model, distortion)), taken, out, OutputRule())
        assert {frame.lens.model for frame in frames(loaded(out))} == {"PINHOLE"}
        for one in taken.images:
            assert (out / "images" / one.name).read_bytes() == one.path.read_bytes()
    assert found.lens == "PINHOLE, as OPENCV was almost straight"
    assert found.sizes == ((WIDTH, HEIGHT),)


def test_kept_files_stay_byte_for_byte(tmp_path):
    names = [f"view_{view}.jpg" for view in range(VIEWS)]
    taken = photos(tmp_path / "photos", names, quality=80)
    found = write_data_set(estimate(lens("OPENCV"), names), taken, tmp_path, KEEP)
    for one in taken.images:
        assert (tmp_path / "images" / one.name).read_bytes() == one.path.read_bytes()
    assert found.lens == "OPENCV as given"
    assert found.bytes == sum(
        item.stat().st_size
        for part in ("images", "sparse")
        for item in (tmp_path / part).rglob("*.*")
    )


def test_all_readers_find_the_model(tmp_path):
    write_data_set(estimate(lens("OPENCV")), photos(tmp_path / "p"), tmp_path, KEEP)
    ours = read_model(tmp_path / "sparse/0")
    theirs = pycolmap.Reconstruction(tmp_path / "sparse/0")
    assert [image.name for image in ours.images] == [f"view_{view}.png" for view in range(VIEWS)]
    assert len(ours.points) == theirs.num_points3D() == 20
    assert sorted(path.name for path in (tmp_path / "sparse/0").iterdir()) == [
        *("cameras.bin", "frames.bin", "images.bin", "points3D.bin", "rigs.bin"),
    ]


def turned(folder: Path, names) -> ImageSet:
    """JPEG files that lie on their side, with a tag that turns them upright."""
    exif = Image.Exif()
    exif[Base.Orientation], exif[Base.Make] = 6, "A maker"
    taken = []
    for view, name in enumerate(names):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        lying = Image.fromarray(image(view)).transpose(Image.Transpose.ROTATE_90)
        lying.save(path, quality=98, subsampling=0, exif=exif, icc_profile=PROFILE)
        taken.append(SourceImage(name, path, read_header(path), Exif()))
    return ImageSet(tuple(taken))


@pytest.mark.parametrize("rule", [OutputRule(), KEEP], ids=["pinhole", "keep"])
def test_turned_images_are_written_upright_without_the_tag(tmp_path, rule):
    names = [f"view_{view}.JPG" for view in range(VIEWS)]
    taken = turned(tmp_path / "photos", names)
    found = write_data_set(estimate(lens("OPENCV"), names), taken, tmp_path / "out", rule)
    with Image.open(tmp_path / "out/images/view_1.JPG") as opened:
        assert opened.format == "JPEG"
        assert opened.size == found.sizes[0]
        exif = opened.getexif()
        assert Base.Orientation not in exif
        assert exif[Base.Make] == "A maker"
        assert opened.info["icc_profile"] == PROFILE
        assert [layer[1:3] for layer in opened.layer] == [(1, 1)] * 3
        if rule is KEEP:
            assert np.abs(np.asarray(opened).astype(int) - image(1)).max() < 12
    assert "4 images that only an EXIF tag turned are stored upright" in found.notes
    assert loaded(tmp_path / "out").views(Split.TRAIN).names == tuple(names)


def test_a_turned_tiff_becomes_an_upright_png(tmp_path):
    names = [f"view_{view}.tif" for view in range(VIEWS)]
    taken = photos(tmp_path / "photos", names)
    for one in taken.images:
        with Image.open(one.path) as opened:
            lying = opened.transpose(Image.Transpose.ROTATE_90)
        lying.save(one.path, tiffinfo={Base.Orientation.value: 6})
    write_data_set(estimate(lens("OPENCV"), names), taken, tmp_path / "out", KEEP)
    assert loaded(tmp_path / "out").views(Split.TRAIN).names[0] == "view_0.png"
    with Image.open(tmp_path / "out/images/view_1.png") as opened:
        assert np.array_equal(np.asarray(opened), image(1))


def test_names_may_have_folders_and_fit_what_is_written(tmp_path):
    names = ["left/a.webp", "left/a.png", "right/a.webp", "right/b.bmp"]
    taken = photos(tmp_path / "photos", names)
    found = write_data_set(estimate(lens("OPENCV"), names), taken, tmp_path, OutputRule())
    new = ["left/a.png", "left/a_2.png", "right/a.png", "right/b.png"]
    assert sorted(loaded(tmp_path).views(Split.TRAIN).names) == new
    written = [item for item in (tmp_path / "images").rglob("*") if item.is_file()]
    assert sorted(item.relative_to(tmp_path / "images").as_posix() for item in written) == new
    for item in written:
        with Image.open(item) as image:
            assert image.format == "PNG"
    assert found.notes == (
        "3 images have another name, which fits their format: left/a.webp is left/a_2.png, for one",
    )


def test_alpha_is_kept(tmp_path):
    taken = photos(tmp_path / "photos")
    for one in taken.images:
        alpha = np.full((HEIGHT, WIDTH, 1), 255, np.uint8)
        alpha[:, :100] = 0
        Image.fromarray(np.concatenate([image(0), alpha], axis=2)).save(one.path)
    taken = ImageSet(tuple(replace(one, header=read_header(one.path)) for one in taken.images))
    write_data_set(estimate(lens("OPENCV")), taken, tmp_path / "out", OutputRule())
    (batch,) = loaded(tmp_path / "out").load(Split.TRAIN, [0], CPU)
    assert batch.alpha is not None
    assert (float(batch.alpha.min()), float(batch.alpha.max())) == (0.0, 1.0)


def test_what_no_lens_saw_is_masked(tmp_path, monkeypatch):
    CameraPlan.of.cache_clear()
    wide = LensRule(blank_pixels=1.0)
    monkeypatch.setattr("gsfw.preparation.writing.camera_plan.LensRule", lambda: wide)
    taken = photos(tmp_path / "photos")
    found = write_data_set(estimate(lens("OPENCV")), taken, tmp_path, OutputRule())
    CameraPlan.of.cache_clear()
    assert "masks/ marks what lenses did not see" in found.notes
    assert (found.images, found.masks) == (4, 4)
    (batch,) = loaded(tmp_path).load(Split.TRAIN, [0], CPU)
    assert batch.valid is not None
    assert 0.5 < float(batch.valid.float().mean()) < 1


def test_the_number_of_jobs_changes_nothing(tmp_path):
    taken, estimated = photos(tmp_path / "photos"), estimate(lens("OPENCV"))
    contents = []
    for jobs in (1, 3):
        out = tmp_path / str(jobs)
        write_data_set(estimated, taken, out, OutputRule(), jobs)
        files = sorted(path for path in out.rglob("*") if path.is_file())
        contents.append([(path.relative_to(out), path.read_bytes()) for path in files])
    assert contents[0] == contents[1]
    assert len(contents[0]) > len(taken.images)


def test_images_that_are_not_registered_are_left_out(tmp_path):
    estimated = estimate(lens("OPENCV"))
    estimated.deregister_frame(estimated.images[2].frame_id)
    found = write_data_set(estimated, photos(tmp_path / "p"), tmp_path, OutputRule())
    names = ("view_0.png", "view_2.png", "view_3.png")
    assert loaded(tmp_path).views(Split.TRAIN).names == names
    assert sorted(item.name for item in (tmp_path / "images").iterdir()) == [*names]
    assert found.images == 3


def test_nothing_of_an_earlier_estimate_stays(tmp_path):
    taken = photos(tmp_path / "photos")
    write_data_set(estimate(lens("OPENCV")), taken, tmp_path, OutputRule())
    before = (tmp_path / "images/view_0.png").read_bytes()
    fewer = estimate(lens("OPENCV", (-0.2, 0.05, 0.0, 0.0)))
    fewer.deregister_frame(fewer.images[2].frame_id)
    write_data_set(fewer, taken, tmp_path, OutputRule())
    assert (tmp_path / "images/view_0.png").read_bytes() != before
    assert not (tmp_path / "images/view_1.png").exists()


class Interrupted:
    """Somebody presses Ctrl-C after the second image."""

    @contextmanager
    def stage(self, name, total):
        assert (name, total) == ("images", VIEWS)

        def advance(done):
            if done == 2:
                raise KeyboardInterrupt

        yield advance


def test_an_interrupted_data_set_has_no_model_and_is_completed_later(tmp_path):
    taken, estimated = photos(tmp_path / "photos"), estimate(lens("OPENCV"))
    write_data_set(estimated, taken, tmp_path / "whole", OutputRule())
    out = tmp_path / "out"
    write_data_set(estimate(lens("SIMPLE_RADIAL")), taken, out, OutputRule())
    with pytest.raises(KeyboardInterrupt), shown_by(Interrupted().stage):
        write_data_set(estimated, taken, out, OutputRule())
    assert not (out / "sparse/0/cameras.bin").exists()
    assert len(list((out / "images").iterdir())) == 2
    write_data_set(estimated, taken, out, OutputRule())
    for item in (tmp_path / "whole").rglob("*.*"):
        same = out / item.relative_to(tmp_path / "whole")
        assert same.read_bytes() == item.read_bytes()


def test_a_full_disk_is_said(tmp_path, monkeypatch):
    taken = photos(tmp_path / "photos")

    def full(handle):
        raise OSError(errno.ENOSPC, "no space")

    monkeypatch.setattr("gsfw.core.files.atomic.os.fsync", full)
    with pytest.raises(OutputError) as error:
        write_data_set(estimate(lens("OPENCV")), taken, tmp_path / "out", OutputRule())
    assert str(error.value) == (
        f"the disk is full: {tmp_path}/out/work/written.txt could not be written.\n"
        "Free some space, or choose another place with out=DIR."
    )


def test_photos_are_never_written_over(tmp_path):
    taken = photos(tmp_path / "images")
    before = [one.path.read_bytes() for one in taken.images]
    with pytest.raises(OutputError, match=r"view_0.png is one of the images that are read"):
        write_data_set(estimate(lens("OPENCV")), taken, tmp_path, OutputRule())
    assert [one.path.read_bytes() for one in taken.images] == before


def test_a_lens_that_folds_the_image_is_refused(tmp_path):
    taken = photos(tmp_path / "photos")
    with pytest.raises(
        DataError,
        match=r"(?s)camera 1 of sparse/0/cameras.bin: its distortion, .* folds.*"
        r"\nCompute it with fewer parameters \(camera_model=SIMPLE_RADIAL\)",
    ):
        write_data_set(estimate(lens("SIMPLE_RADIAL", (-0.9,))), taken, tmp_path, OutputRule())


def test_the_quality_is_that_of_rewritten_jpegs(tmp_path):
    names = [f"view_{view}.jpg" for view in range(VIEWS)]
    taken, estimated = photos(tmp_path / "photos", names), estimate(lens("OPENCV"), names)
    sizes = [
        write_data_set(estimated, taken, tmp_path, OutputRule(jpeg_quality=quality)).bytes
        for quality in (60, 95)
    ]
    assert sizes[0] < sizes[1]
    with Image.open(io.BytesIO((tmp_path / "images/view_0.jpg").read_bytes())) as image:
        assert image.format == "JPEG"


def test_frames_of_a_video_keep_their_times_in_a_transforms_file(tmp_path):
    camera = lens("OPENCV")
    taken, estimated = photos(tmp_path / "frames"), estimate(camera)
    timed = [replace(one, time=0.5 * number) for number, one in enumerate(taken.images)]
    whole = write_data_set(estimated, taken, tmp_path / "out", OutputRule())
    before = loaded(tmp_path / "out").recording
    found = write_data_set(
        estimated, ImageSet(tuple(timed)), tmp_path / "out", OutputRule(), layout="transforms"
    )
    assert (found.layout, found.notes) == ("transforms", ())
    assert (found.images, found.points) == (whole.images, whole.points)
    assert not (tmp_path / "out/sparse").exists()
    assert is_all_there(tmp_path / "out")
    read = TransformsConfig().build(request(tmp_path / "out"))
    after = read.recording
    assert [frame.time for frame in after.frames] == [0.0, 0.5, 1.0, 1.5]
    assert read.scene.num_times == VIEWS
    # The world is turned so that its z points where the model's -y did; views stay as they were.
    turned = torch.stack([before.points[:, 0], before.points[:, 2], -before.points[:, 1]], 1)
    assert torch.allclose(after.points, turned, atol=1e-6)
    for one, other in zip(before.frames, after.frames, strict=True):
        seen = before.points @ one.world_to_camera[:3, :3].T + one.world_to_camera[:3, 3]
        again = after.points @ other.world_to_camera[:3, :3].T + other.world_to_camera[:3, 3]
        assert torch.allclose(seen, again, atol=1e-6)
        assert other.lens.matrix().tolist() == one.lens.matrix().tolist()


def test_the_model_takes_the_place_of_a_transforms_file(tmp_path):
    taken, estimated = photos(tmp_path / "photos"), estimate(lens("OPENCV"))
    found = write_data_set(estimated, taken, tmp_path / "out", OutputRule(), layout="transforms")
    assert "photos have no times: methods for moving scenes need frames of videos" in found.notes[0]
    assert TransformsConfig().build(request(tmp_path / "out")).scene.num_times == 0
    write_data_set(estimated, taken, tmp_path / "out", OutputRule())
    assert not (tmp_path / "out/transforms.json").exists()
    assert not (tmp_path / "out/points.ply").exists()
    assert len(frames(loaded(tmp_path / "out"))) == VIEWS


@pytest.mark.parametrize(
    ("layout", "groups", "times", "note"),
    [
        (
            "colmap",
            ("", "", "", ""),
            (0.0, 1.0, 2.0, 3.0),
            "if the scene moves, layout=transforms keeps",
        ),
        (
            "transforms",
            ("a", "a", "b", "b"),
            (0.0, 1.0, 0.0, 1.0),
            "the times of 2 videos are seconds",
        ),
        (
            "transforms",
            ("a", "a", "", ""),
            (0.0, 1.0, None, None),
            "videos beside them lose theirs",
        ),
    ],
)
def test_notes_say_what_becomes_of_times(layout, groups, times, note, tmp_path):
    taken = [
        replace(one, group=group, time=time)
        for one, group, time in zip(photos(tmp_path / "p").images, groups, times, strict=True)
    ]
    images = ImageSet(tuple(taken))
    model = estimate(lens("OPENCV"))
    found = write_data_set(model, images, tmp_path / "out", OutputRule(), layout=layout)
    assert len(found.notes) == 1
    assert note in found.notes[0]
