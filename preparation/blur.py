"""Blur of images: its direction in one image, and the findings about blurred images.

Motion along a line while the shutter is open multiplies the spectrum by a sinc along that line, so
fine detail is missing in that direction and present in the others. An image of vertical lines has
none along them either, but no coarse detail as well: directions are compared by the ratio of the
energy of fine waves to that of coarse ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Float

from gsfw.core.words import listed
from gsfw.preparation.finding import Finding, Weight
from gsfw.preparation.image_quality import BLURRED, SOFT, ImageQuality, UsualQuality

DIRECTED = 0.15
"""Ratio below which blur has a direction. Of 147 photos of fox and plush three are below, two of
which are smeared; the others have 0.17 to 0.78, and after a Gaussian blur of 2 pixels 0.23 to 0.71.
Blurred along a line of 6 to 24 pixels, photos have 0.01 to 0.12."""
BLOCK = 64
"""Side of the square blocks of a spectrum, in pixels; neighbouring blocks overlap by half."""
DIRECTIONS = 12
"""Compared over half a circle."""
SECTOR = 24
"""Power of the cosine that weighs waves around a direction: half the weight at 14 degrees."""
COARSE = (0.03, 0.10)
"""Cycles for a pixel: a motion of 5 pixels leaves 0.96 to 0.6 of the amplitude of these waves."""
FINE = (0.15, 0.40)
"""Cycles for a pixel: a motion of 5 pixels leaves below 0.3; beyond is aliasing and noise."""
LEAST = 0.02
"""Part of the strongest direction's coarse energy without which a direction shows nothing."""
NOTHING = 1e-7
"""Mean squared level of images without detail: rounding to 8 bits makes 1.3e-6."""
DIRECTED_BLUR = 0.7
"""Part of the usual sharpness below which directed blur is motion: motion leaves edges along it
sharp, so that less is lost than by other blur of the same size."""
MANY_BLURRED, MANY_MOVED = 0.3, 0.1
"""Parts of the images above which leaving out the blurred ones is no remedy, and above which motion
blur limits the result."""
MOST_MOVED = 0.5
"""Part of the images from which on a directed blur is the usual one; below, it has to make an
image less sharp than others, since single edges have a direction as well."""
ALIKE = 20.0
"""Degrees between the directions of blur of two images that moved along one line."""


@dataclass(frozen=True)
class ImageBlur:
    """Measurements of one image that tell how it is blurred."""

    quality: ImageQuality
    direction: float | None = None
    """Degrees, as ``direction_of_blur`` has them; ``None`` where it was not measured."""
    ratio: float = 1.0
    """Fine detail along that direction, in parts of that across."""

    def kind(self, usual: UsualQuality) -> Literal["sharp", "blurred", "motion blur"]:
        """The kind of blur, beside the usual quality of the capture."""
        if self.ratio < DIRECTED and usual.share_of_sharpness(self.quality) < DIRECTED_BLUR:
            return "motion blur"
        soft = usual.sharpness_of(self.quality) < SOFT
        return "blurred" if soft or usual.is_blurred(self.quality) else "sharp"


def direction_of_blur(grey: Float[np.ndarray, "h w"]) -> tuple[float, float]:
    """The direction in which an image lacks fine detail most, and how much it lacks it.

    Args:
        grey: levels in [0, 1].

    Returns:
        The direction in degrees, from 0 to 180, from the x axis towards the y axis (down); and the
        weakest direction's fine detail in parts of the strongest one's, in [0, 1]: below
        ``DIRECTED`` the camera has moved, or something else blurred one direction alone. An image
        without detail, or smaller than a block, gives 0 and 1.
    """
    if min(grey.shape) < BLOCK:
        return 0.0, 1.0
    power = _mean_power(grey)
    coarse, fine = (power.ravel() @ _sectors(band) for band in (COARSE, FINE))
    if power.mean() < NOTHING * BLOCK**2:
        return 0.0, 1.0
    told = coarse >= LEAST * coarse.max()
    ratios = np.where(told, fine / np.where(told, coarse, 1.0), 1.0)[told]
    angles = np.arange(DIRECTIONS)[told] * np.pi / DIRECTIONS
    # The phase of a whole wave over half a circle is less moved by single edges than its least.
    logs = np.log(np.maximum(ratios, 1e-12))
    lack = -((logs - logs.mean()) * np.exp(2j * angles)).sum()
    return float(np.degrees(np.angle(lack) / 2) % 180), float(ratios.min() / ratios.max())


def _mean_power(grey: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "b b"]:
    """Squared amplitudes of the waves of blocks, over all blocks (Welch 1967)."""
    taper = np.outer(np.hanning(BLOCK), np.hanning(BLOCK))
    step = BLOCK // 2
    total = np.zeros((BLOCK, BLOCK))
    rows = range(0, grey.shape[0] - BLOCK + 1, step)
    for row in rows:
        strip = np.lib.stride_tricks.sliding_window_view(grey[row : row + BLOCK], BLOCK, axis=1)
        blocks = strip[:, ::step].swapaxes(0, 1)
        blocks = (blocks - blocks.mean((1, 2), keepdims=True)) * taper
        total += np.square(np.abs(np.fft.fft2(blocks))).mean(0)
    return total / len(rows)


@cache
def _sectors(band: tuple[float, float]) -> Float[np.ndarray, "w k"]:
    """Weights of the waves of a band around each direction, in columns that sum to 1."""
    frequencies = np.fft.fftfreq(BLOCK)
    y, x = (axis.ravel() for axis in np.meshgrid(frequencies, frequencies, indexing="ij"))
    length = np.hypot(x, y)
    directions = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
    weights = np.cos(np.arctan2(y, x)[:, None] - directions) ** SECTOR
    weights[(length < band[0]) | (length >= band[1])] = 0.0
    return np.asarray(weights / weights.sum(0))


def blur_findings(images: Sequence[tuple[str, ImageQuality]]) -> tuple[Finding, ...]:
    """The finding about sharpness, if any: all images are blurred, or some beside the others.

    Args:
        images: names and qualities; images without any texture are another finding.
    """
    usual = UsualQuality.of([quality for _, quality in images])
    if not images:
        return ()
    if usual.sharpness < SOFT:
        return (all_blurred(usual),)
    shares = sorted(
        (usual.share_of_sharpness(quality), name)
        for name, quality in images
        if usual.is_blurred(quality)
    )
    names = tuple(name for _, name in shares)
    if not names:
        return ()
    found = Finding(
        "blurred images",
        Weight.LIMIT,
        f"{len(names)} of {len(images)} images have less than {100 * BLURRED:.0f} % of the "
        f"usual sharpness, the worst {100 * shares[0][0]:.0f} %: {listed(names)}.",
        "They pull the result towards their blur.",
        "Take the capture again with a shorter exposure."
        if len(names) > MANY_BLURRED * len(images)
        else "Leave them out.",
        names,
    )
    return (found,)


def all_blurred(usual: UsualQuality) -> Finding:
    """The finding about a capture whose typical image is blurred."""
    return Finding(
        "all images blurred",
        Weight.LIMIT,
        f"The typical image has hardly an edge (variance of its Laplacian {usual.sharpness:.1g}).",
        "The result can be no sharper than its images, and their features are few and uncertain.",
        "Take the capture again with more light, a shorter exposure and a steady camera; shrunk "
        "images (downscale=2) lose nothing now.",
    )


def motion_findings(images: Mapping[str, ImageBlur], usual: UsualQuality) -> tuple[Finding, ...]:
    """The finding about images that lack fine detail in one direction; none without such images.

    Args:
        images: measurements by name, in the order of the capture.
        usual: typical quality of the capture.
    """
    moved = [
        name
        for name, image in images.items()
        # The stripes of a plain thing have a direction as well.
        if image.direction is not None
        and image.ratio < DIRECTED
        and not usual.is_plain(image.quality)
    ]
    if len(moved) <= MOST_MOVED * len(images):
        moved = [name for name in moved if images[name].kind(usual) == "motion blur"]
    if not moved:
        return ()
    worst = tuple(sorted(moved, key=lambda name: images[name].ratio))
    same = _runs_along_one_line(images, moved)
    line = f"; {same} of them along the same line as the image before" if same else ""
    found = Finding(
        "motion blur",
        Weight.LIMIT if len(moved) > MANY_MOVED * len(images) else Weight.NOTE,
        f"{len(moved)} of {len(images)} images lack fine detail in one direction, down to "
        f"{100 * images[worst[0]].ratio:.0f} % of that across{line}: {listed(worst)}.",
        "The camera or the subject moved while the shutter was open: edges are smeared, and "
        "features are displaced.",
        "Use a shorter exposure or more light, or move more slowly; leave the worst out if others "
        "show the same.",
        worst,
    )
    return (found,)


def _runs_along_one_line(images: Mapping[str, ImageBlur], moved: Sequence[str]) -> int:
    """Number of images that moved along the same line as the image just before them."""
    numbers = {name: number for number, name in enumerate(images)}
    directions = {name: images[name].direction or 0.0 for name in moved}
    return sum(
        numbers[after] == numbers[before] + 1
        and abs((directions[after] - directions[before] + 90) % 180 - 90) < ALIKE
        for before, after in pairwise(moved)
    )
