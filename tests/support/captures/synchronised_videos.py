"""A small capture as synchronised videos, with a calibration."""

from support.captures.calibrations import entry, write_json
from support.small_captures import HEIGHT, WIDTH
from support.small_videos import cameras, write_video

TIMES = 4


def write(folder, where="videos", count=3, draw=None, size=(WIDTH, HEIGHT), **settings):
    """A calibration in OpenCV's pixels, and a video of each camera."""
    capture = cameras(count)
    for view, name in enumerate(capture.names):
        own = {} if draw is None else {"draw": draw(capture.pixels(view))}
        write_video(folder / where / f"{name}.mp4", TIMES, *size, **own)
    write_json(folder / "cameras.json", *(entry(view, **settings) for view in range(count)))
    return folder
