"""Coded colours become sRGB: against the equations in float64, and through files."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.small_captures import HEIGHT, WIDTH

from gsfw.core.errors import DataError
from gsfw.datamanagers.coded_colors import HLG, PQ, coded_to_srgb, compressed
from gsfw.datamanagers.video import Shot, Video
from gsfw.datamanagers.video_traits import VideoTraits

BT2020_TO_BT709 = np.array(
    [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]
)
"""ITU-R BT.2087-0, annex 2."""
LUMINANCE = np.array([0.2627, 0.6780, 0.0593])
"""ITU-R BT.2100-2, table 5."""
FFMPEG = 3
"""Deviation of FFmpeg's conversion from YCbCr, of 255."""
number = st.integers(0, 65535)


def light_of_pq(values):
    """Nits by the EOTF of SMPTE ST 2084."""
    power = values ** (1 / 78.84375)
    inner = np.maximum(power - 0.8359375, 0) / (18.8515625 - 18.6875 * power)
    return 10000 * inner ** (1 / 0.1593017578125)


def light_of_hlg(values):
    """Nits on a display of 1000 nits."""
    bright = (np.exp((values - 0.55991073) / 0.17883277) + 0.28466892) / 12
    scene = np.where(values <= 0.5, values**2 / 3, bright)
    return 1000 * (scene @ LUMINANCE) ** 0.2 * scene


def expected(values, transfer):
    """The number of sRGB, without tables and rounding."""
    light = (light_of_pq if transfer == PQ else light_of_hlg)(values).clip(max=1000)
    light = BT2020_TO_BT709 @ light
    largest = light.max().clip(1e-9, 1000)
    linear = (light * compressed(np.array([largest])) / largest / 203).clip(0, 1)
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def converted(color, transfer, primaries=9):
    return coded_to_srgb(np.array([[color]], np.uint16), transfer, primaries)[0, 0]


@given(color=st.tuples(number, number, number), transfer=st.sampled_from([PQ, HLG]))
def test_colors_are_those_of_the_equations(color, transfer):
    values = np.array(color) / 65535
    assert np.abs(converted(color, transfer) - expected(values, transfer)).max() < 1.2


def test_the_reference_white_of_both_curves_is_the_same_bright_grey():
    """ITU-R BT.2408-7, table 1: 203 nits are 58 % of PQ and 75 % of HLG."""
    hlg, pq = (
        converted([round(part * 65535)] * 3, transfer).astype(int)
        for part, transfer in ((0.75, HLG), (0.5806, PQ))
    )
    assert np.abs(hlg - pq).max() <= 1
    assert set(hlg) <= {227, 228, 229, 230}


@pytest.mark.parametrize("transfer", [PQ, HLG])
def test_greys_stay_grey_rise_and_reach_black_and_white(transfer):
    ramp = np.repeat(np.arange(0, 65536, 17, dtype=np.uint16)[:, None, None], 3, axis=2)
    result = coded_to_srgb(ramp, transfer, 9)[:, 0].astype(int)
    assert np.ptp(result, axis=1).max() == 0
    assert (np.diff(result[:, 0]) >= 0).all()
    assert (result[0, 0], result[-1, 0]) == (0, 255)


def test_light_below_the_knee_is_kept_and_the_peak_becomes_white():
    dark = np.array([0.01, 1.0, 26.0, 80.0])
    assert compressed(dark) == pytest.approx(dark, rel=1e-6)
    assert compressed(np.array([1000.0])) == pytest.approx(203.0)
    curve = compressed(np.linspace(0.01, 1000, 5000))
    assert (np.diff(curve) > 0).all()


def test_primaries_are_those_of_the_file():
    """A grey is the same in all of them, and red less saturated in smaller ones."""
    grey = [converted([30000] * 3, HLG, primaries) for primaries in (1, 9, 12, 2)]
    assert np.ptp(grey, axis=0).max() <= 1
    green = [int(converted([40000, 20000, 20000], HLG, primaries)[1]) for primaries in (9, 12, 1)]
    assert green == sorted(green)
    assert green[0] < green[-1]


COLOR = np.array([0.6, 0.3, 0.45])
"""Numbers of HLG."""


def ten_bits(color) -> list[int]:
    """Y, Cb and Cr (ITU-R BT.2100-2, tables 6 and 9)."""
    luma = float(color @ LUMINANCE)
    blue, red = (color[2] - luma) / 1.8814, (color[0] - luma) / 1.4746
    return [round(64 + 876 * luma), round(512 + 896 * blue), round(512 + 896 * red)]


@pytest.fixture(scope="module")
def hlg_video(tmp_path_factory):
    """A video of 10 bits and of one colour, as phones record it."""
    path = tmp_path_factory.mktemp("hlg") / "a.mp4"
    return write_color(path, ten_bits(COLOR), "yuv420p10le", HLG, 9, 9, 1)


def write_color(path, values, layout, transfer, primaries, matrix, color_range) -> Video:
    """A video of one image of one colour, with its codes."""
    av = pytest.importorskip("av", reason="PyAV, which decodes videos, is not installed")
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"qp": "0"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, layout
        frame = av.VideoFrame(WIDTH, HEIGHT, layout)
        sample = "<u2" if "10" in layout else "u1"
        for plane, value in zip(frame.planes, values, strict=True):
            size = plane.buffer_size // np.dtype(sample).itemsize
            plane.update(np.full(size, value, sample).tobytes())
        codes = {"color_trc": transfer, "color_primaries": primaries, "colorspace": matrix}
        for name, value in (codes | {"color_range": color_range}).items():
            setattr(stream.codec_context, name, value)
            if hasattr(frame, name):  # PyAV 14.1 lacks some.
                setattr(frame, name, value)
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return Video.read(path)


def test_images_of_an_hdr_video_are_converted_unless_they_are_to_stay_as_stored(hlg_video):
    assert hlg_video.traits.transfer == HLG
    assert hlg_video.traits.primaries == 9
    shown = hlg_video.image(0)
    assert shown.shape == (HEIGHT, WIDTH, 3)
    wanted = converted((65535 * COLOR).astype(np.uint16), HLG).astype(int)
    assert np.abs(shown - wanted).max() <= FFMPEG
    stored = Shot(hlg_video, 0).as_stored().video.image(0)
    assert np.abs(stored - 255 * COLOR).max() <= FFMPEG


def test_other_videos_keep_their_numbers_or_only_change_primaries(hlg_video):
    plain = replace(hlg_video, traits=replace(hlg_video.traits, transfer=1, primaries=1))
    assert np.abs(plain.image(0) - 255 * COLOR).max() <= FFMPEG
    wide = replace(hlg_video, traits=replace(hlg_video.traits, transfer=1))
    light = BT2020_TO_BT709 @ (((COLOR + 0.055) / 1.055) ** 2.4)
    assert np.abs(wide.image(0) - 255 * (1.055 * light ** (1 / 2.4) - 0.055)).max() <= FFMPEG


@pytest.mark.parametrize(("matrix", "red", "blue"), [(1, 0.2126, 0.0722), (5, 0.299, 0.114)])
@pytest.mark.parametrize("full", [False, True])
def test_the_matrix_and_range_of_a_file_are_applied(tmp_path, matrix, red, blue, full):
    luma = float(COLOR @ [red, 1 - red - blue, blue])
    chroma = (COLOR[2] - luma) / (2 - 2 * blue), (COLOR[0] - luma) / (2 - 2 * red)
    steps = (255, 255) if full else (219, 224)
    planes = [round((0 if full else 16) + steps[0] * luma)]
    planes += [round(128 + steps[1] * value) for value in chroma]
    video = write_color(tmp_path / "a.mp4", planes, "yuv420p", 1, 1, matrix, 2 if full else 1)
    assert np.abs(video.image(0) - 255 * COLOR).max() <= FFMPEG


def test_a_matrix_that_ffmpeg_does_not_convert_is_told(tmp_path, monkeypatch):
    video = write_color(tmp_path / "a.mp4", [80, 128, 128], "yuv420p", 1, 1, 1, 1)

    def refuse(*_):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(VideoTraits, "colors", refuse)
    with pytest.raises(DataError) as caught:
        video.image(0)
    assert caught.value.message == (
        f"{video.path}: FFmpeg does not convert its colours (matrix 1 of ITU-T H.273): "
        "Operation not supported."
    )


@pytest.mark.parametrize("matrix", [8, 10, 14])
def test_rare_matrices_end_in_colors_or_words(tmp_path, matrix):
    """Versions of FFmpeg differ in what they convert."""
    path = tmp_path / "a.mp4"
    refusal, shapes = "", []
    try:
        video = write_color(path, [80, 128, 128], "yuv444p", 1, 1, matrix, 1)
        shapes = [video.image(0).shape, next(video.greys([0], WIDTH))[1].shape]
    except DataError as error:
        refusal = error.message
    expected = f"{path}: FFmpeg does not convert its colours (matrix {matrix} of ITU-T H.273)"
    assert refusal.startswith(expected) or shapes == [(HEIGHT, WIDTH, 3), (HEIGHT, WIDTH)]
