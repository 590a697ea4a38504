"""What earlier runs have written, and models that are whole or not there."""

import pytest
import torch
from support.small_captures import request, ring, write_colmap, write_images

from gsfw.core.errors import OutputError
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.preparation.writing.written_files import is_all_there, place_model, start_over


def test_only_what_an_earlier_run_wrote_is_removed(tmp_path):
    for name in ("images/a.jpg", "images/b.jpg", "images/mine.jpg", "sparse/0/cameras.bin"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    start_over(tmp_path, ["images/a.jpg", "images/b.jpg", "masks/b.jpg.png"])
    assert not (tmp_path / "sparse/0/cameras.bin").exists()
    start_over(tmp_path, ["images/c.jpg"])
    assert [item.name for item in (tmp_path / "images").iterdir()] == ["mine.jpg"]
    assert (tmp_path / "work/written.txt").read_text() == "images/c.jpg\n"


def test_a_list_that_leads_elsewhere_removes_nothing(tmp_path):
    out, precious = tmp_path / "out", tmp_path / "precious"
    precious.mkdir()
    (precious / "a.jpg").touch()
    (out / "work").mkdir(parents=True)
    (out / "link").symlink_to(precious)
    names = ["../precious/a.jpg", f"{precious}/a.jpg", "link/a.jpg", "", ".", "..", "a\0b", "/"]
    (out / "work/written.txt").write_text("\n".join(names))
    start_over(out, [])
    assert (precious / "a.jpg").exists()
    assert (out / "link").is_symlink()


def test_a_removed_image_or_part_of_the_model_is_noticed(tmp_path):
    names = ["images/a.jpg", "masks/a.jpg.png"]
    start_over(tmp_path, names)
    for name in [*names, *(f"sparse/0/{part}.bin" for part in ("images", "points3D", "cameras"))]:
        assert not is_all_there(tmp_path)
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert is_all_there(tmp_path)


def test_a_model_of_any_parts_is_put_in_place(tmp_path):
    write_images(tmp_path / "images", ring())
    size = place_model(lambda folder: write_colmap(folder, ring()), 4, 20, tmp_path)
    assert size == sum(item.stat().st_size for item in (tmp_path / "sparse/0").iterdir())
    assert not (tmp_path / "sparse/.part").exists()
    points = ColmapConfig().build(request(tmp_path)).recording.points
    assert torch.equal(points, torch.from_numpy(ring().points))


def test_a_model_that_was_cut_short_is_never_put_in_place(tmp_path):
    def write(folder):
        write_colmap(folder, ring())
        points = folder / "points3D.bin"
        points.write_bytes(points.read_bytes()[:100])

    with pytest.raises(OutputError) as error:
        place_model(write, 4, 20, tmp_path)
    assert str(error.value) == (
        f"the model could not be written to {tmp_path}/sparse/.part: what is there ends too "
        "early.\nThe disk is probably full: free some space, or choose another place with out=DIR."
    )
    assert list((tmp_path / "sparse/0").iterdir()) == []
