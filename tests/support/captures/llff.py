"""A small capture as LLFF and Neural 3D Video have it: poses_bounds.npy, and images or videos."""

from dataclasses import replace

import numpy as np

from support.small_captures import FOCAL, HEIGHT, WIDTH, square, write_image
from support.small_videos import write_video


def centred(capture):
    """LLFF knows one focal length, and the principal point in the middle."""
    return replace(square(capture), center=(WIDTH / 2, HEIGHT / 2))


def write_poses(folder, capture, size=(HEIGHT, WIDTH)):
    """A row [R | t | hwf], near, far for each camera; the axes of R are down, right, back."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for pose in capture.poses:
        right, down, forward = pose[:3, :3]
        center = -pose[:3, :3].T @ pose[:3, 3]
        hwf = np.array([*size, FOCAL[0]])
        matrix = np.stack([down, right, -forward, center, hwf], axis=1)
        rows.append([*matrix.flatten(), 0.5, 3.0])
    np.save(folder / "poses_bounds.npy", np.array(rows))
    return folder


def write(folder, capture, shrunk=(1,)):
    """The poses, and the images shrunk by each factor."""
    for factor in shrunk:
        name = "images" if factor == 1 else f"images_{factor}"
        for image in capture.names:
            write_image(folder / name / image, WIDTH // factor, HEIGHT // factor)
    return write_poses(folder, capture)


def write_folders(folder, capture, times=4, inner="images"):
    """A folder of images for each camera."""
    for name in capture.names:
        for time in range(times):
            write_image(folder / name / inner / f"{time:04d}.png")
    return write_poses(folder, capture)


def write_videos(folder, capture, times=6):
    """A video of each camera."""
    for name in capture.names:
        write_video(folder / f"{name}.mp4", count=times)
    return write_poses(folder, capture)
