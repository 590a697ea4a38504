"""A small capture as RealityCapture exports its registration."""

import math

import numpy as np

from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH, ring, write_images

HEADER = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"
DISTORTION = (-0.1, 0.05, -0.02, 0.01, 2e-3, -3e-3)
INTRINSICS = (
    36 * FOCAL[0] / WIDTH,
    (CENTER[0] - WIDTH / 2) / WIDTH,
    (CENTER[1] - HEIGHT / 2) / WIDTH,
)


def angles(pose):
    """Heading, pitch and roll in degrees, from where the camera looks and what is right of it.

    Of an upright camera: it looks to the heading (clockwise from north, which is y), pitch is 90
    at the horizon and 0 straight down, and roll is what it is turned by about its axis.
    """
    right, _, forward = pose[:3, :3]
    heading = math.degrees(math.atan2(forward[0], forward[1]))
    pitch = 90 + math.degrees(math.asin(forward[2]))
    level = np.array([math.cos(math.radians(heading)), -math.sin(math.radians(heading)), 0.0])
    assert np.allclose(right, level), "cameras of the ring stand upright"
    return heading, pitch, 0.0


def row(capture, view, name=None, intrinsics=INTRINSICS, distortion=()):
    pose = capture.poses[view]
    center = -pose[:3, :3].T @ pose[:3, 3]
    values = (*center, *angles(pose), *intrinsics, *(*distortion, *(0,) * 6)[:6])
    return ",".join([name or capture.names[view], *(repr(float(value)) for value in values)])


def write(folder, rows=None, header=HEADER, images="images"):
    capture = ring()
    write_images(folder / images, capture)
    rows = [row(capture, view) for view in range(4)] if rows is None else rows
    (folder / "export.csv").write_text("\n".join([header, *rows]) + "\n")
    return folder
