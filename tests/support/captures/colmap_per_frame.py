"""A small capture with a COLMAP model of each time."""

from dataclasses import replace

from support.small_captures import ring, write_colmap, write_images

TIMES = 3


def moved(time):
    """The ring at a time: its points wander, its cameras do not."""
    capture = replace(ring(4), names=[f"cam{number:02d}.png" for number in range(4)])
    count = 20 - 2 * time
    return replace(
        capture, points=capture.points[:count] + 0.01 * time, colors=capture.colors[:count]
    )


def write(folder, times=range(TIMES)):
    for time in times:
        place = folder / f"colmap_{time}"
        write_colmap(place / "sparse/0", moved(time))
        write_images(place / "images", moved(time))
    return folder
