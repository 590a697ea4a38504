"""`gsfw render` writes pictures that can be opened."""

import json

from PIL import Image

from gsfw.commands.main import main


def test_held_out_views_are_drawn_beside_their_photos_and_an_orbit(finished_run, tmp_path, capsys):
    out = tmp_path / "pictures"
    arguments = ["render", str(finished_run), f"out={out}", "frames=4", "scale=0.5", "json=true"]
    assert main(arguments) == 0
    written = json.loads(capsys.readouterr().out)["written"]
    names = sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())
    assert names == [
        "orbit.webp", "orbit/0000.png", "orbit/0001.png", "orbit/0002.png",
        "orbit/0003.png",
        "views/0000_eval_000.png", "views/0001_eval_001.png",
    ]  # fmt: skip
    assert len(written) == len(names)
    with Image.open(out / "views" / "0000_eval_000.png") as picture:
        assert picture.size == (64, 24)
        assert len(picture.getcolors(10_000) or []) > 10
    with Image.open(out / "orbit" / "0000.png") as picture:
        assert picture.size == (16, 12)
    with Image.open(out / "orbit.webp") as picture:
        assert picture.n_frames == 4


def test_impossible_sizes_are_one_message(finished_run, capsys):
    assert main(["render", str(finished_run), "frames=0"]) == 2
    assert "expected at least 1 frame" in capsys.readouterr().err
