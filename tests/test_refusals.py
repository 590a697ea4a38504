"""What cannot be trained is refused: one clear message, exit code 2, nothing half-written."""

import json
import shutil

import pytest
from PIL import Image
from support.small_captures import (
    ring,
    write_colmap,
    write_image,
    write_images,
    write_transforms,
)

from gsfw.commands.main import main


@pytest.fixture
def refusal(tmp_path, capsys):
    """Try to train; what is said on standard error."""
    out = tmp_path / "run"

    def refuse(*arguments: str, trained: bool = False) -> str:
        given = {argument.partition("=")[0] for argument in arguments}
        defaults = [] if "method" in given else ["method=3dgs"]
        capsys.readouterr()
        assert main(["train", *defaults, *arguments, f"out={out}"]) == 2
        said = capsys.readouterr()
        assert said.err.count("error: ") == 1
        assert "Traceback" not in said.err
        assert out.exists() == trained, "nothing half-written may stay, and nothing trained may go"
        return said.err

    return refuse


@pytest.fixture
def colmap(tmp_path):
    """A small COLMAP data set with its images."""
    capture, folder = ring(), tmp_path / "capture"
    write_colmap(folder / "sparse" / "0", capture)
    write_images(folder / "images", capture)
    return folder


def test_an_unknown_method_is_answered_with_the_nearest(refusal):
    assert "no method '3dgz'. Did you mean '3dgs'?" in refusal("method=3dgz")


def test_a_misspelt_key_is_answered_with_the_nearest(refusal):
    said = refusal("optim.mean_lr=1e-4")
    assert "unknown key 'optim.mean_lr'. Did you mean 'optim.means_lr'?" in said


def test_a_wrong_type_says_what_was_expected(refusal):
    assert "steps=abc: expected a whole number, found 'abc'." in refusal("steps=abc")


def test_a_missing_folder_is_answered_with_the_nearest(refusal, colmap):
    said = refusal(f"data={colmap.parent / 'captrue'}")
    assert "there is no such file or folder" in said
    assert "Did you mean 'capture'?" in said


def test_an_empty_folder_is_called_empty(refusal, tmp_path):
    (tmp_path / "empty").mkdir()
    assert "the folder is empty" in refusal(f"data={tmp_path / 'empty'}")


def test_a_folder_of_no_known_format_is_told_what_was_looked_for(refusal, tmp_path):
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "one.txt").touch()
    said = refusal(f"data={tmp_path / 'notes'}")
    assert "Looked for:" in said
    assert "transforms.json" in said


def test_photos_without_cameras_are_told_how_to_get_them_in_the_first_line(refusal, tmp_path):
    write_image(tmp_path / "photos" / "one.png")
    said = [line for line in refusal(f"data={tmp_path / 'photos'}").splitlines() if "data=" in line]
    assert "Found 1 image, but no cameras; compute them with gsfw prepare " in said[0]
    assert said[0].endswith("out=DIR, and give that folder.")


def test_a_run_in_place_of_a_data_set_is_told_its_data_set(refusal, colmap, tmp_path):
    run = tmp_path / "trained"
    run.mkdir()
    write_image(run / "requirements.png")
    (run / "config.yaml").write_text(f"schema: 1\nmethod: 3dgs\ndata: {colmap}\n")
    said = refusal(f"data={run}")
    assert f"data={run}: this is a run of gsfw, and no data set." in said
    assert f"Give the data set that it was trained on: {colmap}" in said
    (run / "config.yaml").write_text("schema: 1\ndata: ''\ndatamanager: synthetic\n")
    assert "It was trained on datamanager=synthetic, without data." in refusal(f"data={run}")
    (run / "config.yaml").write_text("resolution: 3\n")
    assert "Found 1 image, but no cameras" in refusal(f"data={run}")


def test_a_colmap_model_without_images_is_refused(refusal, colmap):
    shutil.rmtree(colmap / "images")
    said = refusal(f"data={colmap}")
    assert "images" in said
    assert str(colmap) in said


def test_a_truncated_colmap_model_is_refused(refusal, shared_data, tmp_path):
    capture = tmp_path / "cut"
    shutil.copytree(shared_data / "malformed" / "colmap_truncated", capture / "sparse" / "0")
    (capture / "images").mkdir()
    said = refusal(f"data={capture}")
    assert "cut" in said.lower()
    assert ".bin" in said


def test_an_image_that_does_not_decode_is_named(refusal, colmap):
    broken = colmap / "images" / "view_001.png"
    broken.write_bytes(b"this is not an image")
    assert "view_001.png" in refusal(f"data={colmap}")


def test_an_image_cut_short_is_named_even_if_its_header_is_whole(refusal, colmap):
    broken = colmap / "images" / "view_001.png"
    broken.write_bytes(broken.read_bytes()[:-30])
    with Image.open(broken) as image:
        assert image.size == (64, 48)
    assert "view_001.png" in refusal(f"data={colmap}", "steps=8", trained=True)


def test_a_pose_that_is_not_a_number_is_named(refusal, tmp_path):
    capture, folder = ring(), tmp_path / "capture"
    write_images(folder, capture)
    path = write_transforms(folder / "transforms.json", capture)
    document = json.loads(path.read_text())
    document["frames"][2]["transform_matrix"][0][3] = float("nan")
    path.write_text(json.dumps(document))
    said = refusal(f"data={folder}")
    assert "view_002" in said
    assert "transform_matrix" in said or "pose" in said


def test_an_image_of_another_size_than_its_camera_is_refused(refusal, colmap):
    with Image.open(colmap / "images" / "view_000.png") as image:
        image.resize((50, 48)).save(colmap / "images" / "view_000.png")
    said = refusal(f"data={colmap}")
    assert "50x48" in said
    assert "64x48" in said


def test_a_rasterizer_that_is_not_there_is_refused(refusal):
    said = refusal("rasterizer=metal")
    assert "no rasterizer 'metal'" in said
    assert "reference" in said


def test_a_gpu_that_is_not_there_is_refused(refusal):
    import torch

    if torch.cuda.is_available():
        pytest.skip("there is a GPU here")
    assert "device" in refusal("device=cuda:0")


def test_a_splat_file_to_start_from_must_exist(refusal, colmap):
    said = refusal(f"data={colmap}", "init=nowhere.ply")
    assert "nowhere.ply: there is no such file" in said


def test_a_moving_capture_is_refused_by_a_static_method_with_advice(refusal):
    said = refusal("datamanager.moving=true", "datamanager.width=16", "datamanager.height=12")
    assert "ignore_time=true" in said
