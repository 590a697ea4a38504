"""MapFile: one file of a per-view map, in NumPy's formats or as an image."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gsfw.core.batch import Resampling
from gsfw.core.errors import DataError
from gsfw.core.files.array_file import ARRAYS, array_header, read_array
from gsfw.datamanagers.images import EXTENSIONS, Header, decode_numbers, numbers_header

MAP_EXTENSIONS = (*ARRAYS, *EXTENSIONS)
"""Extensions of the files that can hold a map, in the order in which they are looked for."""

DEPTH = "depth"
"""Name of the map of depths; its rule is depth unless another one is given."""
MILLIMETRE = 0.001
"""Unit of depths that are stored as whole numbers, as RGB-D cameras and nerfstudio have them."""


@dataclass(frozen=True)
class MapHeader:
    """The size and type of a map."""

    height: int
    width: int
    channels: int
    stored: np.dtype[np.generic]
    """Type of the stored numbers."""
    loaded: np.dtype[np.floating]
    """Type of the numbers in memory."""


@dataclass(frozen=True)
class MapFile:
    """A file of numbers for each pixel of an image, in the image's distortion, at any resolution.

    Depth is measured along the camera's axis (z), not along the ray.
    """

    path: Path
    """.npy or .npz (one array [h, w, d] or [h, w]), or an image of 8, 16 or 32 bits a channel."""
    rule: Resampling = Resampling.MEAN
    """Rule that undistorts and resizes the map."""
    unit: float = 1.0
    """Factor of the stored numbers; for depth it leads to units of the data's world."""

    @property
    def is_image(self) -> bool:
        """True if the file is an image, not an array."""
        return self.path.suffix.lower() not in ARRAYS

    def header(self, image: Header | None = None) -> MapHeader:
        """The map's size and type, without its numbers.

        Args:
            image: header of the image that the map belongs to; ``None`` checks no shape.

        Raises:
            DataError: the file is damaged or of no known kind, or does not fit the image.
        """
        if not self.is_image:
            found = array_header(self.path)
            shape, dtype = self._axes(found.shape), found.dtype
        else:
            shape, dtype = numbers_header(self.path)
        if dtype.kind not in "biuf" or not 2 <= len(shape) <= 3 or 0 in shape:
            raise DataError(
                f"{self.path} holds {dtype} numbers of the shape {list(shape)}.",
                "Expected real numbers of the shape [height, width, channels].",
            )
        height, width, channels = (*shape, 1)[:3]
        if self.rule is Resampling.DEPTH and channels != 1:
            raise DataError(
                f"{self.path} has {channels} channels.", "Expected one depth for each pixel."
            )
        if image is not None and abs(width * image.height - height * image.width) > max(
            image.height, image.width
        ):
            raise DataError(
                f"{self.path}: the map is {width}x{height} pixels with {channels} "
                f"channel{'s' * (channels != 1)}, its image is {image}.",
                "Expected the array axes [height, width, channels] and the proportions of the "
                "(upright) image; the size may be another.",
            )
        return MapHeader(height, width, channels, dtype, self._loaded(dtype))

    def read(self) -> Float[np.ndarray, "h w d"]:
        """The numbers times the unit, as the type that ``header`` says.

        Raises:
            DataError: the file does not decode.
        """
        if not self.is_image:
            stored = read_array(self.path)
            stored = stored.reshape((*self._axes(stored.shape), 1)[:3])
        else:
            stored = decode_numbers(self.path)
        values = stored.astype(self._loaded(stored.dtype), copy=False)
        return values if self.unit == 1 else values * np.float32(self.unit)

    def _loaded(self, stored: np.dtype[np.generic]) -> np.dtype[np.floating]:
        """float16 stays, as long as nothing is computed with it; all else becomes float32."""
        stays = stored == np.float16 and self.unit == 1 and self.rule is not Resampling.DEPTH
        return np.dtype(np.float16) if stays else np.dtype(np.float32)

    def _axes(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """The shape of an array without axes of length 1 that cannot be its height."""
        axes = 2 if self.rule is Resampling.DEPTH else 3
        if len(shape) == 3 and axes == 2 and shape[2] == 1:
            return shape
        while len(shape) > axes and shape[0] == 1:
            shape = shape[1:]
        return shape
