"""What is said of paths that are no data set."""

from zipfile import ZipFile

from support.small_captures import ring, write_colmap, write_image, write_transforms

from gsfw.datamanagers.blender import BlenderConfig
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.datamanagers.detection import describe_unrecognised
from gsfw.datamanagers.transforms import TransformsConfig

FORMATS = (ColmapConfig, TransformsConfig, BlenderConfig)


def recognised(path) -> list:
    found = [(kind.detect(path).priority, kind) for kind in FORMATS if kind.detect(path).recognised]
    return [kind for _, kind in sorted(found, key=lambda item: -item[0])]


def test_images_without_cameras_lead_to_prepare(tmp_path):
    for index in range(3):
        write_image(tmp_path / "images" / f"{index}.png")
    assert describe_unrecognised(tmp_path) == (
        "3 images in images/, but no cameras; compute them with gsfw prepare "
        f"{tmp_path / 'images'} out=DIR, and give that folder"
    )
    assert ColmapConfig.detect(tmp_path).found == describe_unrecognised(tmp_path)
    assert describe_unrecognised(tmp_path / "images").startswith("3 images, but no cameras")


def test_photos_of_an_iphone_lead_to_prepare_and_its_recordings_to_unzip(tmp_path):
    (tmp_path / "IMG_1.HEIC").touch()
    assert describe_unrecognised(tmp_path).startswith("1 image, but no cameras; compute them with")
    (tmp_path / "red.R3D").write_bytes(b"of a camera of RED")
    assert describe_unrecognised(tmp_path / "red.R3D") == ""
    with ZipFile(tmp_path / "a.r3d", "w") as archive:
        archive.writestr("metadata", "{}")
    assert describe_unrecognised(tmp_path / "a.r3d") == (
        f"a recording of Record3D: unzip {tmp_path / 'a.r3d'} -d DIR, and give that folder"
    )


def test_a_video_leads_to_prepare(tmp_path):
    (tmp_path / "walk.MP4").touch()
    for path in (tmp_path, tmp_path / "walk.MP4"):
        assert describe_unrecognised(path) == (
            "the video walk.MP4, but no cameras; compute them with gsfw prepare "
            f"{tmp_path / 'walk.MP4'} out=DIR, and give that folder"
        )


def test_a_folder_of_data_sets_names_them(tmp_path):
    write_colmap(tmp_path / "fox/sparse/0", ring())
    write_transforms(tmp_path / "chair/transforms_train.json", ring())
    (tmp_path / "notes").mkdir()
    (tmp_path / "room/rgb").mkdir(parents=True)
    (tmp_path / "room/metadata.json").write_text("{}")
    assert describe_unrecognised(tmp_path) == (
        "data sets in chair/, fox/, room/; give one of these folders"
    )


def test_nothing_is_said_of_what_is_unknown(tmp_path):
    (tmp_path / "notes.md").touch()
    assert describe_unrecognised(tmp_path) == ""
    assert describe_unrecognised(tmp_path / "notes.md") == ""
    assert recognised(tmp_path) == []


def test_every_format_is_recognised_by_its_own_loader_alone(tmp_path):
    write_colmap(tmp_path / "a/sparse/0", ring())
    write_transforms(tmp_path / "b/transforms.json", ring())
    write_transforms(tmp_path / "c/transforms_train.json", ring())
    assert recognised(tmp_path / "a") == [ColmapConfig]
    assert recognised(tmp_path / "b") == [TransformsConfig]
    assert recognised(tmp_path / "b/transforms.json") == [TransformsConfig]
    assert recognised(tmp_path / "c") == [BlenderConfig]
    assert recognised(tmp_path / "c/transforms_train.json") == [BlenderConfig]


def test_where_several_fit_colmap_wins_as_it_has_points(tmp_path):
    write_colmap(tmp_path / "sparse", ring())
    write_transforms(tmp_path / "transforms.json", ring())
    write_transforms(tmp_path / "transforms_train.json", ring())
    assert recognised(tmp_path) == [ColmapConfig, BlenderConfig, TransformsConfig]
    assert ColmapConfig.detect(tmp_path).found == "sparse/cameras.bin"
