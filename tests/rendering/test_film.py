"""Films from frames on disk."""

import builtins
import sys
from types import SimpleNamespace

import pytest
import torch
from PIL import Image

from gsfw.core.errors import OutputError, UnavailableError
from gsfw.datamanagers.video import Video
from gsfw.rendering.film import choose_format, write_film
from gsfw.rendering.image_files import write_image


@pytest.fixture
def frames(tmp_path):
    """Three grey frames of odd size, each brighter than the last."""
    return [
        write_image(tmp_path / "frames" / f"{i:04d}.png", torch.full((31, 45, 3), 0.2 + 0.3 * i))
        for i in range(3)
    ]


@pytest.fixture
def no_encoder(monkeypatch):
    """A machine without PyAV."""
    imported = builtins.__import__

    def refuse(name, *arguments, **settings):
        if name == "av":
            raise ImportError(name)
        return imported(name, *arguments, **settings)

    monkeypatch.setattr(builtins, "__import__", refuse)


def test_an_image_is_clamped_and_rounded(tmp_path):
    values = torch.tensor([[[-1.0, 0.5, 2.0]]])
    with Image.open(write_image(tmp_path / "a.png", values)) as image:
        assert image.getpixel((0, 0)) == (0, 128, 255)


def test_a_webp_shows_every_frame_for_its_time(frames, tmp_path):
    (path,) = write_film(tmp_path / "film", frames, 25, "webp")
    assert path == tmp_path / "film.webp"
    with Image.open(path) as film:
        assert (film.n_frames, film.size) == (3, (45, 31))
        film.seek(1)
        film.load()
        assert film.info["duration"] == 40


@pytest.mark.parametrize(("form", "codecs"), [("mp4", {"h264"}), ("webm", {"vp9", "libvpx-vp9"})])
def test_a_video_has_every_frame_and_an_even_size(frames, tmp_path, form, codecs):
    av = pytest.importorskip("av", reason="PyAV is not installed (extra video)")
    assert choose_format("auto") == "mp4"
    (path,) = write_film(tmp_path / "film", frames, 25, form)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name in codecs
        assert stream.average_rate == 25
        images = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert [image.shape for image in images] == [(30, 44, 3)] * 3
    means = [image.mean() / 255 for image in images]
    assert means == pytest.approx([0.2, 0.5, 0.8], abs=0.02)
    assert sorted(item.name for item in tmp_path.iterdir()) == [f"film.{form}", "frames"]


@pytest.mark.parametrize("form", ["mp4", "webm"])
def test_a_video_states_how_its_colors_are_coded(tmp_path, form):
    """Players guess otherwise, by the size of the image."""
    av = pytest.importorskip("av", reason="PyAV is not installed (extra video)")
    color = torch.tensor([0.8, 0.25, 0.15]).expand(32, 48, 3)
    frame = write_image(tmp_path / "0000.png", color)
    (path,) = write_film(tmp_path / "film", [frame], 25, form)
    shown = Video.read(path).image(0)
    assert abs(shown / 255 - color.numpy()).max() < 0.02
    with av.open(str(path)) as container:
        image = next(container.decode(video=0))
        codes = container.streams.video[0].codec_context
        assert (image.colorspace, image.color_range) == (1, 1)
        assert (codes.color_primaries, codes.color_trc) == (1, 13)


def test_no_film_is_made_where_none_is_wanted(frames, tmp_path):
    assert write_film(tmp_path / "film", frames, 25, "none") == []
    assert choose_format("none") == "none"


def test_without_an_encoder_auto_is_webp(no_encoder):
    assert choose_format("auto") == "webp"
    assert choose_format("webp") == "webp"


@pytest.mark.parametrize("form", ["mp4", "webm"])
def test_without_an_encoder_a_video_says_what_to_install(no_encoder, form):
    with pytest.raises(UnavailableError) as error:
        choose_format(form)
    assert str(error.value) == (
        f"video={form} needs an encoder, and PyAV is not installed.\n"
        "Install it with: pip install 'gsfw[video]' (or: pip install av). "
        "video=webp needs nothing more."
    )


def test_an_encoder_without_the_codec_is_none(monkeypatch):
    poor = SimpleNamespace(codecs_available={"mpeg4"}, __version__="1.2")
    monkeypatch.setitem(sys.modules, "av", poor)
    assert choose_format("auto") == "webp"
    with pytest.raises(UnavailableError, match=r"the installed PyAV 1\.2 has no libx264"):
        choose_format("mp4")
    with pytest.raises(UnavailableError, match=r"the installed PyAV 1\.2 has no libvpx-vp9"):
        choose_format("webm")


def test_a_place_that_cannot_be_written_is_one_message(frames, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        write_film(tmp_path / "file" / "film", frames, 25, "webp")
