"""ViewPath: how far the view of a moving camera has come, from image to image.

Small grey images are compared tile by tile through phase correlation (Kuglin and Hines 1975):
the phases of the cross-power spectrum tell the shift, whatever the exposure is. We weigh the
spectrum with a Gaussian: high frequencies are noise and compression, and the peak becomes a
Gaussian, whose place three samples tell.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float
from scipy import fft

from gsfw.preparation.image_quality import EMPTY

SIDE = 160
"""The longer side of the images that are compared, in pixels."""
TILE = 32
"""Side of a tile, in pixels; tiles overlap by half."""
PASS = 0.15
"""Standard deviation of the weights of frequencies, in cycles per pixel."""
MATCHED = 0.4
"""Least peak of a tile that is seen again, of 1. Measured: 0.21 for half of the tiles of unrelated
photos and 0.38 for the best, 0.8 for half of those of photos that a step lies between."""
KNOWN = 0.2
"""Least part of the tiles that has to be seen again for two images to show the same: it is 0.06
for cameras on two sides of a room, and 0.7 where a person fills the view of one that stands."""
RENEWED = 1 / 20
"""Shift, of the longer side, after which a newer image is compared with: more than hands tremble,
and less than the 1/15 that tiles see."""
NOISE = 0.0005
"""Shift, of the longer side, that counts as none: cameras that stand still come to 0.0003."""
BLINK = 3
"""Largest number of strange images in a row; more are a scene of their own."""
SAME = 0.5
"""Part of the tiles that is seen again, at least, where the view has hardly moved."""
NO_OVERLAP = 0.5
"""Shift, of the longer side, that is counted where two images have nothing in common."""


@dataclass(frozen=True)
class Overlap:
    """Measurements of a pair of images."""

    shift: float
    """Shift of the view, in parts of the longer side: the median of the tiles with something in
    them, where those that are not seen again have moved the furthest of all. What moves before a
    camera that stands still does not count so, as long as it fills less than half of the view."""
    seen: float
    """Part of the tiles with something in them that is seen again, in [0, 1]."""

    @property
    def found(self) -> bool:
        """True if enough is seen again for the shift to mean something."""
        return self.seen >= KNOWN


def overlap(first: Float[np.ndarray, "h w"], second: Float[np.ndarray, "h w"]) -> Overlap:
    """Compare two grey images, in levels of [0, 255]."""
    near = _overlap_at(first, second, (0, 0))
    if near.seen >= SAME:
        return near
    # Further than a tile sees: the images as a whole tell about where to look.
    _, down, right = _peaks(*((image - image.mean())[None] for image in (first, second)))
    far = _overlap_at(first, second, (round(float(down[0])), round(float(right[0]))))
    return max(near, far, key=lambda found: found.seen)


def is_plain(image: Float[np.ndarray, "h w"]) -> bool:
    """True if there is nothing in an image, in levels of [0, 255], that could be seen again."""
    return not _textured(_tiles(image, min(TILE, *image.shape))).any()


@dataclass
class ViewPath:
    """Follows a camera through images in order of time.

    Each is compared with one from where the view last had moved by a twentieth of its longer side,
    not with the one before: trembling hands go back and forth, and arrive nowhere.
    """

    positions: list[float] = field(default_factory=list)
    """Accumulated motion of the view at each image, in longer sides; never falls."""
    strange: list[bool] = field(default_factory=list)
    """True if an image is plain, or shows something else than those before and after, as where a
    flash goes off."""
    jumps: list[int] = field(default_factory=list)
    """Numbers of the images that have nothing in common with those before."""
    _anchors: list[_Anchor] = field(default_factory=list)
    """Images that the next may follow: the latest, and behind it the one before a jump."""
    _before: Float[np.ndarray, "h w"] | None = None

    def add(self, image: Float[np.ndarray, "h w"]) -> None:
        """The next image, in levels of [0, 255]; all have one size."""
        plain = is_plain(image)
        self.strange.append(plain)
        self.positions.append(self.positions[-1] if self.positions else 0.0)
        if plain:
            return
        if not self._anchors:
            self._anchors = [_Anchor(image, self.positions[-1])]
        elif not (self._goes_on(image) or self._returns(image)):
            self._jump(image)
        self._before = image

    def _goes_on(self, image: Float[np.ndarray, "h w"]) -> bool:
        """True if the image overlaps with the latest anchor, or with the image before."""
        anchor = self._anchors[-1]
        found = overlap(anchor.image, image)
        if not found.found and self._before is not None and self._before is not anchor.image:
            anchor = _Anchor(self._before, self.positions[-1])
            found = overlap(anchor.image, image)
        if not found.found:
            return False
        self.positions[-1] = max(self.positions[-1], anchor.position + found.shift)
        if found.shift > RENEWED or found.seen < SAME:
            anchor = _Anchor(image, self.positions[-1])
        self._anchors = [anchor]
        return True

    def _returns(self, image: Float[np.ndarray, "h w"]) -> bool:
        """True if the image goes on from before a jump: what came between was strange."""
        if len(self._anchors) < 2:
            return False
        anchor = self._anchors[0]
        between = len(self.positions) - 1 - anchor.until
        found = overlap(anchor.image, image)
        if between > BLINK or found.seen < SAME:
            return False
        while self.jumps and self.jumps[-1] >= anchor.until:
            self.jumps.pop()
        self.strange[anchor.until : -1] = [True] * between
        reached = self.positions[anchor.until - 1]
        self.positions[anchor.until :] = [reached] * between + [
            max(reached, anchor.position + found.shift)
        ]
        self._anchors = [_Anchor(image, self.positions[-1])]
        return True

    def _jump(self, image: Float[np.ndarray, "h w"]) -> None:
        """Nothing of the image has been seen before."""
        number, position = len(self.positions) - 1, self.positions[-1]
        before = self._anchors[0]
        if len(self._anchors) == 1 and self._before is not None:
            before = _Anchor(self._before, position, number)
        self.jumps.append(number)
        self.positions[-1] = position + NO_OVERLAP
        self._anchors = [before, _Anchor(image, self.positions[-1])]


@dataclass(frozen=True)
class _Anchor:
    """An image that others are compared with."""

    image: Float[np.ndarray, "h w"]
    position: float
    until: int = 0
    """Number of the first image that did not go on from it; 0 while all do."""


def _overlap_at(
    first: Float[np.ndarray, "h w"], second: Float[np.ndarray, "h w"], shift: tuple[int, int]
) -> Overlap:
    """Compare the tiles of two images, the second moved back by ``shift`` (down, right)."""
    (height, width), (down, right) = first.shape, shift
    common = height - abs(down), width - abs(right)
    size = min(TILE, height, width)
    if min(common) < size:
        return Overlap(0.0, 0.0)
    ours = _tiles(_part(first, max(-down, 0), max(-right, 0), common), size)
    theirs = _tiles(_part(second, max(down, 0), max(right, 0), common), size)
    counts = _textured(ours) & _textured(theirs)
    if not counts.any():
        return Overlap(0.0, 0.0)
    peaks, downs, rights = _peaks(ours[counts], theirs[counts])
    matched = peaks > MATCHED
    if not matched.any():
        return Overlap(0.0, 0.0)
    shifts = np.sort(np.hypot(downs + down, rights + right)[matched])
    middle = shifts[min(len(peaks) // 2, len(shifts) - 1)]
    moved = max(0.0, float(middle) / max(height, width) - NOISE)
    return Overlap(moved, float(matched.mean()))


def _part(
    image: Float[np.ndarray, "h w"], top: int, left: int, size: tuple[int, int]
) -> Float[np.ndarray, "h2 w2"]:
    return image[top : top + size[0], left : left + size[1]]


def _tiles(image: Float[np.ndarray, "h w"], size: int) -> Float[np.ndarray, "n size size"]:
    """Square parts that overlap by half, less their means."""
    step = max(1, size // 2)
    views = np.lib.stride_tricks.sliding_window_view(image, (size, size))[::step, ::step]
    parts = views.reshape(-1, size, size)
    return np.asarray(parts - parts.mean((1, 2), keepdims=True))


def _textured(tiles: Float[np.ndarray, "n h w"]) -> Bool[np.ndarray, " n"]:
    return np.asarray(tiles.std((1, 2)) > 255 * EMPTY)


def _peaks(
    first: Float[np.ndarray, "n h w"], second: Float[np.ndarray, "n h w"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Correlation of pairs of images, at most 1, and their shifts down and right in pixels."""
    count, height, width = first.shape
    window, weights, highest = _filters(height, width)
    power = fft.rfft2(second * window) * fft.rfft2(first * window).conj()
    size = np.abs(power)
    # Frequencies that neither image has would add phases at random.
    phases = power / (size + 1e-3 * size.mean((1, 2), keepdims=True) + 1e-12)
    surface = fft.irfft2(weights * phases, (height, width)) / highest
    best = surface.reshape(count, -1).argmax(1)
    y, x, each = best // width, best % width, np.arange(count)
    peak = surface[each, y, x]
    down = _vertex(surface[each, y - 1, x], peak, surface[each, (y + 1) % height, x])
    right = _vertex(surface[each, y, x - 1], peak, surface[each, y, (x + 1) % width])
    # Shifts are circular: the far half of them goes the other way.
    down += (y + height // 2) % height - height // 2
    right += (x + width // 2) % width - width // 2
    return peak, down, right


def _vertex(
    before: Float[np.ndarray, " n"], peak: Float[np.ndarray, " n"], after: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Peak of a Gaussian through three samples, in samples from the middle one."""
    low, middle, high = (np.log(np.maximum(values, 1e-3)) for values in (before, peak, after))
    bend = np.minimum(low - 2 * middle + high, -1e-6)
    return np.asarray((0.5 * (low - high) / bend).clip(-0.5, 0.5))


@lru_cache(maxsize=16)
def _filters(
    height: int, width: int
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w2"], float]:
    """Window of the pixels, weights of the frequencies, and the peak of a perfect match."""
    window = np.hanning(height + 2)[1:-1, None] * np.hanning(width + 2)[None, 1:-1]
    frequencies = np.hypot(fft.fftfreq(height)[:, None], fft.rfftfreq(width)[None])
    weights = np.exp(-0.5 * (frequencies / PASS) ** 2)
    highest = float(fft.irfft2(weights, (height, width))[0, 0])
    return window.astype(np.float32), weights.astype(np.float32), highest
