"""ViewMatches: places that two images show alike, found without their cameras.

SIFT features (Lowe 2004) of the small previews are matched between all pairs, and pairs are kept
whose matches a fundamental matrix explains (Hartley and Zisserman 2003, section 11.6). As no pose
and no focal length takes part, the matches can speak about both.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from gsfw.core.cameras import CameraModel
from gsfw.preparation.check.image_sample import ImageSample
from gsfw.preparation.check.viewpoints import Viewpoints
from gsfw.preparation.native import load_colmap
from gsfw.preparation.sift import ERRORS, sift

FEATURES = 400
"""Features of an image: a preview of 400 pixels has about 400 that other images show, too."""
MOST = 60
"""Largest number of images, spread evenly over the sample: each pair takes 3 ms."""
RATIO = 0.8
"""A match has to be nearer than the second best by this factor (Lowe 2004, section 7.1)."""
FEWEST = 20
"""Matches of a pair below which it says nothing: a fundamental matrix explains 8 of any."""
EXPLAINED = 0.5
"""Part of a pair's matches that one fundamental matrix has to explain."""
TOLERANCE = 1.5
"""Pixels of a preview that a match may be off its epipolar line."""
TRIALS = (30, 300)
"""Fewest and most samples of RANSAC."""
KEPT = 40
"""Matches of a pair that are kept, spread evenly."""
UNMOVED = 1.0
"""Pixels of a preview: what is at the same place to within this has not moved in the image."""


@dataclass(frozen=True)
class ViewMatches:
    """``m`` matches of ``q`` pairs of images."""

    views: Int[np.ndarray, " i"]
    """Viewpoints of the images that were compared."""
    pairs: Int[np.ndarray, "q 2"]
    """Viewpoints of each pair."""
    pair: Int[np.ndarray, " m"]
    """Row of each match in ``pairs``; ascending."""
    first: Float[np.ndarray, "m 2"]
    """Pixel in the first image of the pair, at the size of the viewpoint."""
    second: Float[np.ndarray, "m 2"]
    """Pixel in the second."""
    unmoved: Float[np.ndarray, "i i"]
    """Part of the matches of two images that lie at the same pixel in both; NaN for images of one
    pose, and where there are fewer than ``FEWEST``. Such matches are in no pair."""
    problem: str = ""
    """The reason why images could not be matched, if COLMAP does not load."""

    @staticmethod
    def of(viewpoints: Viewpoints, sample: ImageSample) -> ViewMatches:
        """Match all pairs of the sampled images, or of ``MOST`` of them, that differ in pose.

        There are none between cameras other than pinholes.
        """
        pinholes = all(camera.model is CameraModel.PINHOLE for camera in viewpoints.cameras)
        usable = sample.images if pinholes else ()
        chosen = np.unique(np.linspace(0, len(usable) - 1, MOST).astype(int))
        images = [usable[index] for index in chosen] if usable else []
        places = viewpoints.place_of[[image.view for image in images]]
        if len(np.unique(places)) < 2:
            return ViewMatches.none()
        try:
            _load_colmap()
        except (ImportError, RuntimeError) as error:
            return ViewMatches.none(str(error))
        features = [_features(image.pixels) for image in images]
        unmoved = np.full((len(images), len(images)), np.nan)
        pairs, found = [], []
        for i, j in combinations(range(len(images)), 2):
            if places[i] == places[j]:
                continue
            matched = _matched(features[i][1], features[j][1])
            first, second = features[i][0][matched[:, 0]], features[j][0][matched[:, 1]]
            moved = np.linalg.norm(first - second, axis=1) > UNMOVED
            if len(moved) >= FEWEST:
                unmoved[i, j] = unmoved[j, i] = 1 - moved.mean()
            first, second = first[moved], second[moved]
            explained = _explained(first, second)
            if explained.sum() < max(FEWEST, EXPLAINED * len(first)):
                continue
            kept = np.flatnonzero(explained)
            kept = kept[np.unique(np.linspace(0, len(kept) - 1, KEPT).astype(int))]
            views = images[i].view, images[j].view
            sides = (images[i].pixels.shape[1::-1], images[j].pixels.shape[1::-1])
            scales = [viewpoints.sizes[v] / side for v, side in zip(views, sides, strict=True)]
            pairs.append(views)
            found.append((first[kept] * scales[0], second[kept] * scales[1]))
        return ViewMatches(
            views=np.array([image.view for image in images], np.int64),
            pairs=np.array(pairs, np.int64).reshape(-1, 2),
            pair=np.repeat(np.arange(len(found)), [len(one) for one, _ in found]),
            first=np.concatenate([np.zeros((0, 2)), *(one for one, _ in found)]),
            second=np.concatenate([np.zeros((0, 2)), *(other for _, other in found)]),
            unmoved=unmoved,
        )

    @staticmethod
    def none(problem: str = "") -> ViewMatches:
        """No matches of no images."""
        nothing, pixels = np.zeros(0, np.int64), np.zeros((0, 2))
        return ViewMatches(
            nothing, np.zeros((0, 2), np.int64), nothing, pixels, pixels, np.zeros((0, 0)), problem
        )

    def where(self, chosen: Bool[np.ndarray, " q"]) -> ViewMatches:
        """Some of the pairs."""
        used = chosen[self.pair]
        return ViewMatches(
            self.views,
            self.pairs[chosen],
            (np.cumsum(chosen) - 1)[self.pair[used]],
            self.first[used],
            self.second[used],
            self.unmoved,
        )


def _load_colmap() -> None:
    """Load COLMAP, and keep what it says of each image off the terminal."""
    load_colmap()
    from pycolmap import logging

    logging.minloglevel = max(logging.minloglevel, ERRORS)


def _features(
    pixels: UInt8[np.ndarray, "h w 3"],
) -> tuple[Float[np.ndarray, "n 2"], Float32[np.ndarray, "n 128"]]:
    """Positions, and descriptors of length 1 whose products are those of RootSIFT."""
    keypoints, descriptors = sift(pixels, FEATURES, enlarged=False)
    sums = np.maximum(descriptors.sum(1, dtype=np.float32, keepdims=True), 1)
    return keypoints[:, :2].astype(np.float64), np.sqrt(descriptors / sums, dtype=np.float32)


def _matched(
    first: Float32[np.ndarray, "n 128"], second: Float32[np.ndarray, "k 128"]
) -> Int[np.ndarray, "m 2"]:
    """Mutual nearest neighbours that pass the ratio test."""
    if min(len(first), len(second)) < FEWEST:
        return np.zeros((0, 2), np.int64)
    alike = first @ second.T
    best = alike.argmax(1)
    rows = np.arange(len(first))
    mutual = rows[alike.argmax(0)[best] == rows]
    nearest = 1 - alike[mutual, best[mutual]]
    alike[mutual, best[mutual]] = -1
    good = nearest < RATIO**2 * (1 - alike[mutual].max(1))
    return np.stack([mutual[good], best[mutual[good]]], axis=1)


def _explained(
    first: Float[np.ndarray, "n 2"], second: Float[np.ndarray, "n 2"]
) -> Bool[np.ndarray, " n"]:
    """True for matches that one fundamental matrix explains."""
    import pycolmap

    if len(first) < FEWEST:
        return np.zeros(len(first), bool)
    options = pycolmap.RANSACOptions()
    options.max_error = TOLERANCE
    options.min_num_trials, options.max_num_trials = TRIALS
    options.random_seed = 0
    found = pycolmap.estimate_fundamental_matrix(first, second, options)
    return np.zeros(len(first), bool) if found is None else np.asarray(found["inlier_mask"], bool)
