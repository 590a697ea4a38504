"""Splats of formats that cannot be read."""

import gzip
import json
import zipfile

import pytest
from support.small_captures import write_image

from gsfw.commands.main import main
from gsfw.core.errors import DataError
from gsfw.plugins.unread_splats import refuse_unread_splats

SOG = {
    "version": 2,
    "count": 4,
    "means": {"mins": [0, 0, 0], "maxs": [1, 1, 1], "files": ["means_l.webp", "means_u.webp"]},
    "scales": {"codebook": [0.0], "files": ["scales.webp"]},
    "quats": {"files": ["quats.webp"]},
    "sh0": {"codebook": [0.0], "files": ["sh0.webp"]},
}


def refusal(path) -> str:
    with pytest.raises(DataError) as caught:
        refuse_unread_splats(path)
    return str(caught.value)


@pytest.fixture
def sog(tmp_path):
    folder = tmp_path / "my sog"
    for entry in ("means", "scales", "quats", "sh0"):
        for name in SOG[entry]["files"]:
            write_image(folder / name.replace("webp", "png"))
            (folder / name.replace("webp", "png")).rename(folder / name)
    (folder / "meta.json").write_text(json.dumps(SOG))
    return folder


def test_a_sog_is_recognised_as_folder_as_description_and_as_archive(sog, tmp_path):
    said = (
        f"{sog}: these are splats in the format SOG, which gsfw cannot read yet.\n"
        "Convert them to PLY first: npx @playcanvas/splat-transform "
        f"'{sog}/meta.json' splats.ply"
    )
    assert refusal(sog) == said
    assert refusal(sog / "meta.json").endswith(f"'{sog}/meta.json' splats.ply")
    archive = tmp_path / "splats.sog"
    with zipfile.ZipFile(archive, "w") as made:
        made.write(sog / "meta.json", "meta.json")
    assert refusal(archive).endswith(f"splat-transform {archive} splats.ply")


@pytest.mark.parametrize("packed", [True, False])
def test_an_spz_is_recognised_by_content(tmp_path, packed):
    content = b"NGSP" + bytes(12)
    path = tmp_path / "splats.bin"
    path.write_bytes(gzip.compress(content) if packed else content)
    assert refusal(path).startswith(f"{path}: these are splats in the format SPZ, which")


def test_anything_else_passes(tmp_path):
    refuse_unread_splats(tmp_path)
    refuse_unread_splats(tmp_path / "nothing")
    for name, content in {
        "empty": b"",
        "other.gz": gzip.compress(b"NGSX"),
        "cut.gz": gzip.compress(b"NGSP")[:12],
        "other.zip": b"PK\x03\x04",
        "meta.json": b'{"means": 1, "scales": {}}',
    }.items():
        (tmp_path / name).write_bytes(content)
        refuse_unread_splats(tmp_path / name)
    refuse_unread_splats(tmp_path)
    (tmp_path / "meta.json").write_bytes(b"no JSON")
    refuse_unread_splats(tmp_path)


@pytest.mark.parametrize(
    "command",
    [
        ["info", "{}"],
        ["info", "data={}"],
        ["check", "{}"],
        ["prepare", "{}", "out=scene"],
        ["train", "method=3dgs", "data={}"],
        ["train", "method=3dgs", "datamanager.views=4", "init={}"],
        ["export", "{}"],
        ["render", "{}"],
    ],
)
def test_every_verb_says_the_same(sog, tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    spz = tmp_path / "a.spz"
    spz.write_bytes(b"NGSP" + bytes(12))
    for path, name in ((sog, "SOG"), (spz, "SPZ")):
        if command[-1] == "init={}" and path is sog:
            path = sog / "meta.json"  # noqa: PLW2901 - init is a file
        assert main([word.format(path) for word in command]) == 2
        said = capsys.readouterr().err
        assert f"these are splats in the format {name}, which gsfw cannot read yet.\n" in said
        assert "npx @playcanvas/splat-transform" in said
    assert not (tmp_path / "scene").exists()
