"""Lens: a camera of any of COLMAP's models, in pixels of the image size that it describes.

What the models' formulas are is left to pycolmap, which is loaded only where a lens is distorted.
See https://colmap.github.io/cameras.html.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.errors import DataError

COEFFICIENTS: dict[str, tuple[str, ...]] = {
    "SIMPLE_PINHOLE": (),
    "PINHOLE": (),
    "SIMPLE_RADIAL": ("k1",),
    "RADIAL": ("k1", "k2"),
    "OPENCV": ("k1", "k2", "p1", "p2"),
    "OPENCV_FISHEYE": ("k1", "k2", "k3", "k4"),
    "FULL_OPENCV": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "FOV": ("omega",),
    "SIMPLE_RADIAL_FISHEYE": ("k1",),
    "RADIAL_FISHEYE": ("k1", "k2"),
    "THIN_PRISM_FISHEYE": ("k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"),
    "RAD_TAN_THIN_PRISM_FISHEYE": (
        *("k0", "k1", "k2", "k3", "k4", "k5"),
        *("p0", "p1", "s0", "s1", "s2", "s3"),
    ),
    "SIMPLE_DIVISION": ("k",),
    "DIVISION": ("k",),
    "SIMPLE_FISHEYE": (),
    "FISHEYE": (),
    "EUCM": ("alpha", "beta"),
}
"""Parameters of each model after fx, fy, cx and cy."""
ONE_FOCAL_LENGTH = (
    *("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"),
    *("SIMPLE_DIVISION", "SIMPLE_FISHEYE"),
)
"""Models whose parameters begin with f instead of fx and fy."""
STRAIGHT_AT_ZERO = (
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"),
    *("SIMPLE_DIVISION", "DIVISION", "FOV"),
)
"""Models that are pinholes where all coefficients are 0."""
ROUND_TRIP = 1e-6
"""Largest difference, at unit focal length, between a pixel and where its ray leads back to."""
SMALLEST, MOST_PIXELS = 1e-6, 1e12
"""Pixels of a focal length at least, and of it and of the principal point at most: what is beyond
becomes 0 or infinite in the float32 of cameras."""
OVERFLOW = 1e9
"""At unit focal length; numbers beyond are those of a model that explodes outside its range."""


@dataclass(frozen=True)
class Lens:
    """The intrinsics of a camera: a pinhole, unless it says otherwise."""

    fx: float
    """Focal length across, in pixels."""
    fy: float
    """Focal length down, in pixels."""
    cx: float
    """Principal point from the left edge, in pixels: the centre of the first pixel is at 0.5."""
    cy: float
    """Principal point from the upper edge, in pixels."""
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    source: str = field(compare=False)
    """Source of the figures, for messages: "camera 1 of sparse/0/cameras.bin"."""
    model: str = "PINHOLE"
    """Camera model as COLMAP calls it, such as OPENCV or OPENCV_FISHEYE."""
    distortion: tuple[float, ...] = ()
    """COLMAP's parameters after fx, fy, cx, cy (or f, cx, cy), in COLMAP's order."""

    @property
    def is_pinhole(self) -> bool:
        """True if straight lines stay straight in the image."""
        return self.model in STRAIGHT_AT_ZERO and not any(self.distortion)

    @property
    def is_fisheye(self) -> bool:
        """True if the model is one for very wide lenses."""
        return "FISHEYE" in self.model or self.model in ("FOV", "EUCM")

    def __str__(self) -> str:
        names = COEFFICIENTS.get(self.model, ())
        pairs = zip(names, self.distortion, strict=False)
        numbers = ", ".join(f"{name}={value:g}" for name, value in pairs)
        return f"{self.model} ({numbers})" if numbers else self.model

    def matrix(self) -> Float64[Tensor, "3 3"]:
        """The intrinsics."""
        return torch.tensor(
            [[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]],
            dtype=torch.float64,
        )

    def resized(self, width: int, height: int) -> Lens:
        """The same lens, in pixels of an image of another size."""
        x, y = width / self.width, height / self.height
        return replace(
            self,
            fx=self.fx * x,
            fy=self.fy * y,
            cx=self.cx * x,
            cy=self.cy * y,
            width=width,
            height=height,
        )

    def check(self) -> None:
        """Check the numbers.

        Raises:
            DataError: they are not those of a camera.
        """
        numbers = torch.tensor([self.fx, self.fy, self.cx, self.cy], dtype=torch.float64)
        sizes = (self.fx, self.fy, self.width, self.height)
        if not (numbers.abs() <= MOST_PIXELS).all() or not min(sizes) >= SMALLEST:
            raise DataError(
                f"{self.source}: fx={self.fx:g}, fy={self.fy:g}, cx={self.cx:g}, cy={self.cy:g}, "
                f"{self.width}x{self.height} pixels is no camera.",
                "Focal lengths and sizes have to be positive, and all numbers finite and below "
                f"{MOST_PIXELS:g}.",
            )
        if self.model not in COEFFICIENTS:
            raise DataError(
                f"{self.source}: cameras of the model {self.model} cannot be used.",
                f"Expected one of {', '.join(COEFFICIENTS)}.",
            )
        expected = COEFFICIENTS[self.model]
        if len(self.distortion) != len(expected):
            raise DataError(
                f"{self.source}: {len(self.distortion)} distortion parameters for the model "
                f"{self.model}.",
                f"Expected {len(expected)} ({', '.join(expected)})."
                if expected
                else "Remove them.",
            )
        if not np.isfinite(self.distortion).all():
            raise DataError(
                f"{self.source}: its distortion, {self}, is not finite.",
                "Estimate the camera again.",
            )

    def project(self, slopes: Float64[np.ndarray, "m 2"]) -> Float64[np.ndarray, "m 2"]:
        """Pixels that rays fall on; nan where the model has none.

        Args:
            slopes: x / z and y / z of each ray, in camera axes.
        """
        return self._bend(slopes) * (self.fx, self.fy) + (self.cx, self.cy)

    def unproject(self, pixels: Float64[np.ndarray, "m 2"]) -> Float64[np.ndarray, "m 2"]:
        """Slopes of the rays that fall on pixels; nan where none in front of the camera does."""
        unit = (pixels - (self.cx, self.cy)) / (self.fx, self.fy)
        if self.is_pinhole:
            return unit
        slopes: Float64[np.ndarray, "m 2"] = self._unit_camera().cam_from_img(unit)
        # Beyond what a model reaches pycolmap may answer with numbers that mean nothing.
        there = np.abs(self._bend(slopes) - unit).max(axis=1) < ROUND_TRIP
        return np.where(there[:, None], slopes, np.nan)

    def _bend(self, slopes: Float64[np.ndarray, "m 2"]) -> Float64[np.ndarray, "m 2"]:
        """Image points of rays at focal length 1, with the principal point at 0."""
        if self.is_pinhole:
            return slopes
        rays = np.concatenate([slopes, np.ones((len(slopes), 1))], axis=1)
        bent = self._unit_camera().img_from_cam(rays)
        return np.where(np.abs(bent) < OVERFLOW, bent, np.nan)

    def _unit_camera(self) -> Any:  # noqa: ANN401 - pycolmap has no types
        """The camera with focal length 1 and the principal point at 0, for any fx, fy."""
        import pycolmap

        model, distortion = self.model, self.distortion
        if not distortion and self.is_fisheye:
            # The same camera by a name that pycolmap knew before version 4.
            model, distortion = "OPENCV_FISHEYE", (0.0, 0.0, 0.0, 0.0)
        if model not in pycolmap.CameraModelId.__members__:
            raise DataError(
                f"{self.source}: pycolmap {pycolmap.__version__} does not know cameras of the "
                f"model {model}.",
                "Install a newer one: pip install -U pycolmap.",
            )
        focal = (1.0,) if model in ONE_FOCAL_LENGTH else (1.0, 1.0)
        return pycolmap.Camera(
            model=model,
            width=self.width,
            height=self.height,
            params=[*focal, 0.0, 0.0, *distortion],
        )
