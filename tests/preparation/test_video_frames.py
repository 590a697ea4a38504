"""Frames that are chosen of a video, and their files."""

import json

import numpy as np
import pytest
from PIL import Image
from support.panorama import HEIGHT, WIDTH, colored, view
from support.small_videos import write_video

from gsfw.core.errors import ConfigError, DataError, OutputError
from gsfw.datamanagers.video import Video
from gsfw.preparation.frame_spacing import NEAREST
from gsfw.preparation.video_frames import FrameChoice, choose_frames, write_frames

# Seconds each; .ci/run runs them.
pytestmark = pytest.mark.slow

MOVING, STILL, PAN, HALF_BLURRED = range(40), range(40, 80), range(80, 90), range(90, 130)
"""The numbers of the frames of each part of the long video."""

STARTS = np.cumsum([0] + [4] * 40 + [0] * 40 + [30] * 10 + [4] * 39)
"""Pixels of the panorama where each of its views begins."""


def film(path, views, **options) -> Video:
    """A video of images that are given."""
    write_video(
        path,
        count=len(views),
        width=views[0].shape[1],
        height=views[0].shape[0],
        draw=lambda number, width, height: views[number],
        **options,
    )
    return Video.read(path)


@pytest.fixture(scope="module")
def long_video(tmp_path_factory) -> Video:
    """A camera that moves, stands still while it gets dark, pans, and then is blurred at times."""
    views = []
    for number, start in enumerate(STARTS):
        dark = 0.7 if number in STILL[10:] else 1.0
        blurred = number in HALF_BLURRED and number % 2
        views.append(colored(dark * view(start), blur=1.5 if blurred else 0.0))
    return film(tmp_path_factory.mktemp("videos") / "long.mp4", views, key_every=25)


@pytest.fixture(scope="module")
def choice(long_video) -> FrameChoice:
    """Of the long video."""
    return choose_frames(long_video, 50)


def within(choice: FrameChoice, numbers: range) -> list[int]:
    return [number for number in choice.numbers if number in numbers]


def test_as_many_are_chosen_as_asked_for_in_order_with_their_times(choice, long_video):
    assert len(choice.numbers) == pytest.approx(50, abs=3)
    assert list(choice.numbers) == sorted(set(choice.numbers))
    assert choice.seconds == pytest.approx([long_video.times[n] for n in choice.numbers])
    assert choice.looked_at == len(long_video)
    assert choice.notes == ()


def test_while_the_camera_stands_still_no_view_is_taken_twice(choice):
    starts = STARTS[list(choice.numbers)]
    assert len(within(choice, STILL)) <= 1
    assert (np.diff(starts) >= NEAREST * WIDTH).all()


def test_a_quick_pan_gives_every_frame_it_has(choice):
    assert len(within(choice, PAN)) >= 9


def test_where_every_other_frame_is_blurred_the_sharp_ones_are_taken(choice):
    chosen = within(choice, HALF_BLURRED)
    assert len(chosen) >= 10
    assert all(number % 2 == 0 for number in chosen)
    assert min(choice.sharpness) > 0.5
    assert max(choice.sharpness) <= 1


def test_blurred_frames_are_left_out_even_where_too_few_are_sharp(long_video):
    choice = choose_frames(long_video, 200)
    assert all(number % 2 == 0 for number in within(choice, HALF_BLURRED))
    assert choice.notes == (
        f"{len(choice.numbers)} frames chosen where 200 were asked for: the video has 130",
    )


def test_blurred_frames_are_taken_where_nothing_else_bridges_them(tmp_path):
    views = [
        colored(view(20 * number), blur=1.5 if 10 <= number < 20 else 0.0) for number in range(30)
    ]
    choice = choose_frames(film(tmp_path / "a.mp4", views), 30)
    assert len(within(choice, range(10, 20))) >= 8
    (note,) = choice.notes
    assert note.endswith(
        "of 30 chosen frames are blurred (less than 30 % of the sharpness of neighbouring frames), "
        "and without them the view would jump: move the camera slower there"
    )


def test_frames_that_are_stored_twice_are_taken_once(tmp_path):
    views = [colored(view(5 * (number // 2))) for number in range(60)]
    choice = choose_frames(film(tmp_path / "a.mp4", views, rate=60), 40)
    assert len(choice.numbers) >= 28
    assert len({number // 2 for number in choice.numbers}) == len(choice.numbers)
    assert choice.notes[0].startswith(
        f"{len(choice.numbers)} frames chosen where 40 were asked for: with more of them, the view "
        "would change by less than 0.5% of an image's longer side from one to the next"
    )


def test_a_camera_that_stands_still_is_told_so(tmp_path):
    views = [colored(view(200)) for _ in range(20)]
    for number, image in enumerate(views):
        image[100:180, 8 * number : 8 * number + 60] = 40
    choice = choose_frames(film(tmp_path / "a.mp4", views), 10)
    assert len(choice.numbers) == 1
    assert choice.notes == (
        "the camera hardly moves (1 frame chosen where 10 were asked for): the view shifts by "
        "0.00% of an image's longer side in 0.6 s, and cameras are found only where they move "
        "around what they show; several cameras that stand still need a calibration",
    )


def test_real_cameras_that_stand_still_are_told_so(shared_data):
    path = shared_data / "dynamic" / "people_video" / "single_videos" / "cam03.mp4"
    choice = choose_frames(Video.read(path), 50)
    assert len(choice.numbers) == 1
    assert choice.notes[0].startswith("the camera hardly moves (1 frame chosen where 50 were")


def test_cuts_are_told(tmp_path):
    views = [colored(view(8 * number, seed=int(number >= 15))) for number in range(30)]
    choice = choose_frames(film(tmp_path / "a.mp4", views), 20)
    assert choice.notes == (
        "cut or very quick turn at 0.5 s: the views before and after have nothing in common, and "
        "cameras may not be found across it",
    )
    assert min(len(within(choice, part)) for part in (range(15), range(15, 30))) >= 8


def test_flashes_are_left_out(tmp_path):
    views = [colored(view(8 * number)) for number in range(30)]
    views[11][:] = 255
    choice = choose_frames(film(tmp_path / "a.mp4", views), 30)
    assert 11 not in choice.numbers
    assert choice.notes == (
        "1 of 30 frames are left out: they show nothing, or something else than those before and "
        "after",
    )


def test_images_without_order_are_told(tmp_path):
    views = [colored(view(100, seed=number)) for number in range(6)]
    choice = choose_frames(film(tmp_path / "a.mp4", views, rate=1), 6)
    assert choice.numbers == tuple(range(6))
    assert choice.notes == (
        "at 5 of 6 frames the view has nothing in common with the one before: the camera moves "
        "too quickly to follow, or this is no film of one place",
    )


def test_a_video_that_shows_nothing_still_gives_a_frame(tmp_path):
    views = [np.full((48, 64, 3), 90, np.uint8)] * 5
    choice = choose_frames(film(tmp_path / "a.mp4", views), 3)
    assert len(choice.numbers) == 1
    assert choice.notes == (
        "the video shows nothing that could be followed: 1 frame chosen where 3 were asked for",
    )


@pytest.mark.parametrize("length", [1, 2, 3])
def test_short_videos_give_what_they_have(tmp_path, length):
    views = [colored(view(40 * number)) for number in range(length)]
    choice = choose_frames(film(tmp_path / "a.mp4", views), 10)
    assert choice.numbers == tuple(range(length))
    frames = f"{length} frame{'s' if length > 1 else ''}"
    assert choice.notes == (f"{frames} chosen where 10 were asked for: the video has {length}",)


def test_a_varying_rate_is_no_matter(tmp_path):
    stamps = [number + 20 * (number >= 10) for number in range(20)]
    views = [colored(view(8 * number)) for number in range(20)]
    choice = choose_frames(film(tmp_path / "a.mp4", views, stamps=stamps), 20)
    assert choice.numbers == tuple(range(20))
    assert choice.seconds[10] - choice.seconds[9] == pytest.approx(21 / 30)


def test_of_long_videos_only_some_frames_are_looked_at(tmp_path):
    views = [np.tile(np.arange(64, dtype=np.uint8), (48, 1))[..., None].repeat(3, 2)] * 300
    choice = choose_frames(film(tmp_path / "a.mp4", views, rate=60, key_every=100), 2)
    # 300 // (20 * 2) = 7 is odd as it is, and below a fifth of a second, 12.
    assert choice.looked_at == 43


def test_less_than_one_frame_is_refused(long_video):
    with pytest.raises(ConfigError, match=r"^frames=0: expected at least 1\.\nThe usual number"):
        choose_frames(long_video, 0)


def test_a_choice_is_the_same_each_time_and_after_a_journal(choice, long_video):
    assert choose_frames(long_video, 50) == choice
    assert FrameChoice.of(json.loads(json.dumps(choice.document()))) == choice


def test_a_damaged_video_is_refused_when_it_is_reached(tmp_path):
    views = [colored(view(60 * number)) for number in range(20)]
    path = film(tmp_path / "a.mp4", views).path
    content = bytearray(path.read_bytes())
    middle, length = len(content) // 2, len(content) // 4
    content[middle : middle + length] = b"\xff" * length
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"a\.mp4: .*(is damaged|does not decode)"):
        choose_frames(Video.read(path), 10)


FEW = FrameChoice((3, 24, 26, 60), (0.1, 0.8, 0.87, 2.0), (1.0,) * 4, 130)
"""Of the long video, whose segments have 25 frames: two of them in one."""


def test_frames_are_written_by_their_numbers_with_colours_at_full_resolution(tmp_path, long_video):
    files = write_frames(long_video, FEW, tmp_path / "frames")
    assert [file.name for file in files] == ["000003.jpg", "000024.jpg", "000026.jpg", "000060.jpg"]
    assert sorted((tmp_path / "frames").iterdir()) == list(files)
    for number, file in zip(FEW.numbers, files, strict=True):
        with Image.open(file) as image:
            assert image.format == "JPEG"
            assert [layer[1:3] for layer in image.layer] == [(1, 1)] * 3
            pixels = np.asarray(image)
        assert pixels.shape == (HEIGHT, WIDTH, 3)
        assert np.abs(pixels.astype(int) - long_video.image(number)).mean() < 1.5


def test_frames_that_are_there_are_kept_and_not_decoded_again(tmp_path, long_video, monkeypatch):
    files = write_frames(long_video, FEW, tmp_path)
    before = {file: file.stat().st_mtime_ns for file in files}
    files[2].unlink()
    (tmp_path / "other.txt").touch()
    asked = []
    images = Video.images

    def watched(video, numbers):
        asked.append(list(numbers))
        return images(video, numbers)

    monkeypatch.setattr(Video, "images", watched)
    assert write_frames(long_video, FEW, tmp_path) == files
    assert asked == [[26]]
    assert {file: file.stat().st_mtime_ns for file in files if file != files[2]} == {
        file: time for file, time in before.items() if file != files[2]
    }
    assert (tmp_path / "other.txt").exists()
    write_frames(long_video, FEW, tmp_path)
    assert asked == [[26]]


def test_each_segment_is_decoded_once(tmp_path, long_video, monkeypatch):
    asked = []
    images = Video.images
    monkeypatch.setattr(
        Video,
        "images",
        lambda video, numbers: (asked.append(list(numbers)), images(video, numbers))[1],
    )
    write_frames(long_video, FEW, tmp_path)
    assert asked == [[3, 24], [26], [60]]


def test_an_interruption_leaves_whole_frames_only(tmp_path, long_video, monkeypatch):
    def interrupted(video, numbers):
        yield numbers[0], np.zeros((8, 8, 3), np.uint8)
        raise KeyboardInterrupt

    monkeypatch.setattr(Video, "images", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_frames(long_video, FEW, tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["000003.jpg"]


def test_a_full_disk_is_told(tiny_disk, long_video):
    many = FrameChoice(tuple(range(100)), (0.0,) * 100, (1.0,) * 100, 130)
    with pytest.raises(OutputError, match=r"the disk is full: .*\.jpg could not be written\."):
        write_frames(long_video, many, tiny_disk / "frames")
    for file in (tiny_disk / "frames").iterdir():
        with Image.open(file) as image:
            image.load()


def test_a_place_that_cannot_be_written_to_is_told(tmp_path, long_video):
    (tmp_path / "frames").write_text("a file")
    with pytest.raises(
        OutputError, match=r"000003\.jpg cannot be written: (File exists|Not a dir)"
    ):
        write_frames(long_video, FEW, tmp_path / "frames")
