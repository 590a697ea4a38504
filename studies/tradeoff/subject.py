"""Subject: a model with its rasterizer and settings, of which variants change one part."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import interpolate

from gsfw.core.cameras import Cameras
from gsfw.core.model import PrimitiveModel
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.studies.tradeoff.storage import Cut, Storage

Edit = Callable[[Splats, Cameras | None], Splats]
"""Changes the splats of any time before they are rendered for a camera, or written (``None``)."""


@dataclass(frozen=True)
class Subject:
    """A model and the way in which it is rendered."""

    model: PrimitiveModel
    rasterizer: Rasterizer
    settings: RenderSettings
    is_still: bool
    """True if it looks the same at every time."""
    read: Splats | None = None
    """Splats of a file, in the scene frame, in place of the model's; ``None`` for the model's."""
    edits: tuple[Edit, ...] = ()
    """Applied to the splats in this order."""
    dtype: torch.dtype = torch.float32
    """Type for rendering."""
    shrink: int = 1
    """Factor by which images are rendered smaller, and then enlarged."""
    float_bytes: int = 4
    """Bytes of a stored parameter."""

    @property
    def is_splats(self) -> bool:
        """True if it is one set of splats, the same at all times and for all cameras."""
        return self.is_still and (self.read is not None or not self.model.depends_on_view)

    @torch.no_grad()
    def splats(
        self, time: Float[Tensor, ""] | None = None, camera: Cameras | None = None
    ) -> Splats:
        """The splats at ``time`` in [0, 1], which a static model ignores.

        Without a ``camera`` they are those of files. The model sees it in the size of its render.
        """
        seen = None if camera is None else self._rendered_as(camera)
        splats = self.model.splats(time, seen) if self.read is None else self.read
        for edit in self.edits:
            splats = edit(splats, camera)
        return splats.map(lambda tensor: tensor.detach().to(self.dtype))

    def splats_by_camera(self, cameras: Sequence[Cameras]) -> Iterator[Splats]:
        """The splats for each camera, at its time; made once where they are the same for all."""
        splats = None
        for camera in cameras:
            if splats is None or not self.is_splats:
                splats = self.splats(None if camera.time is None else camera.time[0], camera)
            yield splats

    @torch.no_grad()
    def render(self, splats: Splats, camera: Cameras) -> RenderOutput:
        """Render one camera, in the subject's type and size.

        Raises:
            ValueError: the splats have values that cannot be drawn.
        """
        settings = in_dtype(self.settings, self.dtype)
        seen = self._rendered_as(camera).to(dtype=self.dtype)
        return self.rasterizer.render(splats, seen, settings)

    def _rendered_as(self, camera: Cameras) -> Cameras:
        """The same view in the size of its render."""
        sides = (max(1, round(side / self.shrink)) for side in (camera.width, camera.height))
        return camera.resized(*sides)

    @torch.no_grad()
    def image(self, splats: Splats, camera: Cameras) -> Float[Tensor, "h w 3"]:
        """Render an image in the size of one camera; float32.

        Raises:
            ValueError: the splats have values that cannot be drawn.
        """
        output = self.render(splats, camera)
        extra = None if output.extra is None else output.extra.float()
        color, alpha = output.color.float(), output.alpha.float()
        output = replace(output, color=color, alpha=alpha, extra=extra)
        height, width = output.color.shape[1:3]
        decoded = self.model.decode(output, camera.resized(width, height))
        return enlarged(decoded.color[0], camera)

    def num_gaussians(self) -> int:
        """Number of stored Gaussians."""
        return len(self.splats()) if self.is_splats else self._storage().num_rows

    def num_floats(self) -> int:
        """Number of stored floats: of the splats, or of the parameters of other models."""
        if self.is_splats:
            return sum(tensor.numel() for tensor in _stored(self.splats()).tensors().values())
        return round(self._storage().num_bytes / self.float_size())

    def _storage(self) -> Storage:
        """The model's storage after the edits."""
        storage = Storage.of(self.model)
        for edit in self.edits:
            storage = edit.left_of(storage) if isinstance(edit, Cut) else storage
        return storage

    def float_size(self) -> int:
        """Bytes of a parameter of the model in memory."""
        return next(iter(self.model.columns().values())).values.element_size()


def _stored(splats: Splats) -> Splats:
    """The splats without the coefficients of unused bands."""
    colors = splats.colors
    if not isinstance(colors, Sh) or colors.offsets is not None:
        return splats
    return replace(splats, colors=Sh(colors.dense(), colors.degree))


def enlarged(image: Float[Tensor, "a b d"], camera: Cameras) -> Float[Tensor, "h w d"]:
    """An image in the size of a camera, bilinear between the centres of pixels."""
    size = (camera.height, camera.width)
    if tuple(image.shape[:2]) == size:
        return image
    planes = image.movedim(2, 0)[None]
    return interpolate(planes, size, mode="bilinear", align_corners=False)[0].movedim(0, 2)


def in_dtype(settings: RenderSettings, dtype: torch.dtype) -> RenderSettings:
    """The same settings for splats of another type."""
    background = settings.background
    return replace(settings, background=None if background is None else background.to(dtype))
