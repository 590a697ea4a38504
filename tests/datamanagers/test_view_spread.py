"""Views from all over a capture."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from gsfw.datamanagers.frames import Frame, Lens
from gsfw.datamanagers.images import Header
from gsfw.datamanagers.view_spread import spread_views

FRAME = Frame(
    "a",
    Path("a"),
    Header(1, 1, False),
    Lens(1.0, 1.0, 0.5, 0.5, 1, 1, "test"),
    torch.eye(4).double(),
)


def at(*centers: tuple[float, float]) -> list[Frame]:
    """Cameras at places of a plane that all look up."""
    frames = []
    for x, y in centers:
        pose = torch.eye(4).double()
        pose[:2, 3] = torch.tensor([-x, -y])
        frames.append(replace(FRAME, world_to_camera=pose))
    return frames


def test_each_region_gives_one_and_keeps_one_beside_it():
    corners = [(0, 0), (100, 0), (0, 100), (100, 100)]
    frames = at(*[(x + d, y) for x, y in corners for d in (0, 3, 4, 9)])
    chosen = spread_views(frames, 4)
    assert [index // 4 for index in chosen] == [0, 1, 2, 3]
    assert {index % 4 for index in chosen} <= {1, 2}, "those that are missed least"


def test_the_only_view_of_a_region_is_never_chosen():
    frames = at((1000, 0), *[(x, 0) for x in range(20)])
    for count in (2, 5, 10):
        assert 0 not in spread_views(frames, count)


def test_a_chosen_view_keeps_its_nearest_neighbour():
    generator = np.random.default_rng(1)
    frames = at(*[(float(x), float(y)) for x, y in generator.uniform(size=(40, 2))])
    centers = np.stack([-frame.world_to_camera[:2, 3].numpy() for frame in frames])
    chosen = spread_views(frames, 10)
    assert 5 <= len(chosen) <= 10
    rest = [index for index in range(40) if index not in chosen]
    to_rest = np.linalg.norm(centers[chosen][:, None] - centers[rest], axis=2).min(axis=1)
    to_all = np.linalg.norm(centers[:, None] - centers, axis=2)
    np.fill_diagonal(to_all, np.inf)
    assert np.median(to_rest) <= np.median(to_all.min(axis=1)), "they are no gaps"


def test_one_view_or_copies_of_one_are_no_difficulty():
    assert spread_views(at((0, 0)), 1) == []
    assert len(spread_views(at(*[(0, 0)] * 8), 2)) >= 1
