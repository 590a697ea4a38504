"""Stands in for the gsplat package on the CPU: its 1.5.3 interface over the reference's stages.

What gsplat returns in packed mode, in several processes or for its other projections is not played.
"""

from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.numerics import GSPLAT_1_5
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.rasterizers.reference.bin import bin_ellipses
from gsfw.rasterizers.reference.blend import blend
from gsfw.rasterizers.reference.layers import projected_splats
from gsfw.rasterizers.reference.project import Ellipses, project, view_colors, visible_extents
from gsfw.rasterizers.reference.tile_buffer import CutOffs, Measurements, TileBuffer

MODELS = {
    "pinhole": CameraModel.PINHOLE,
    "ortho": CameraModel.ORTHOGRAPHIC,
    "fisheye": CameraModel.FISHEYE,
}


@dataclass(frozen=True)
class Absolute(Measurements):
    """Has backward leave the sums of absolute gradients with the centres, as gsplat does."""

    camera: int
    centres: Tensor

    def record_gradients(self, centres: Tensor, absolute: Tensor | None) -> None:
        if absolute is not None:
            if not hasattr(self.centres, "absgrad"):
                self.centres.absgrad = torch.zeros_like(self.centres)
            self.centres.absgrad[self.camera, self.rows] = absolute


def rasterization(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colors: Tensor,
    viewmats: Tensor,
    Ks: Tensor,
    width: int,
    height: int,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: int | None = None,
    packed: bool = True,
    tile_size: int = 16,
    backgrounds: Tensor | None = None,
    render_mode: str = "RGB",
    sparse_grad: bool = False,
    absgrad: bool = False,
    rasterize_mode: str = "classic",
    channel_chunk: int = 32,
    distributed: bool = False,
    camera_model: str = "pinhole",
    segmented: bool = False,
    covars: Tensor | None = None,
    with_ut: bool = False,
    with_eval3d: bool = False,
    radial_coeffs: Tensor | None = None,
    tangential_coeffs: Tensor | None = None,
    thin_prism_coeffs: Tensor | None = None,
    ftheta_coeffs: Any = None,
    rolling_shutter: Any = None,
    viewmats_rs: Tensor | None = None,
) -> tuple[Tensor, Tensor, dict[str, Any]]:
    n, c = len(means), len(viewmats)
    assert not packed, "not played here"
    assert n > 0, "the real one ends the process"
    assert means.shape == (n, 3)
    assert opacities.shape == (n,)
    assert viewmats.shape == (c, 4, 4)
    assert Ks.shape == (c, 3, 3)
    assert covars is None or covars.shape == (n, 3, 3)
    assert covars is not None or (quats.shape == (n, 4) and scales.shape == (n, 3))
    if sh_degree is None:
        assert colors.shape[:-1] in ((n,), (c, n))
    else:
        assert colors.shape[:-2] == (n,)
        assert (sh_degree + 1) ** 2 <= colors.shape[-2]
    assert render_mode in ("RGB", "RGB+D", "RGB+ED")
    shape = {} if covars is not None else {"quats": quats, "scales": scales}
    splats = Splats(means, opacities, means, covariances=covars, **shape)
    cameras = Cameras(viewmats, Ks, width, height, MODELS[camera_model])
    settings = RenderSettings(
        near=near_plane,
        far=far_plane,
        antialias=rasterize_mode == "antialiased",
        profile=replace(GSPLAT_1_5, dilation=eps2d),
    )
    seen = [See(splats, cameras.select([index]), settings) for index in range(c)]
    centres = torch.stack([view.centres for view in seen])
    channels = [_channels(splats, colors, sh_degree, view, i) for i, view in enumerate(seen)]
    if render_mode != "RGB":
        channels = [
            torch.cat([held, view.ellipses.depths[:, None]], dim=1)
            for held, view in zip(channels, seen, strict=True)
        ]
        if backgrounds is not None:
            backgrounds = torch.cat([backgrounds, backgrounds.new_zeros(c, 1)], dim=1)
    assert backgrounds is None or backgrounds.shape == (c, channels[0].shape[1])
    painted = [
        view.paint(held, index, centres, absgrad)
        for index, (view, held) in enumerate(zip(seen, channels, strict=True))
    ]
    image = torch.stack([image for image, _ in painted])
    alpha = 1 - torch.stack([left for _, left in painted])
    if backgrounds is not None:
        image = image + (1 - alpha) * backgrounds[:, None, None]
    if render_mode == "RGB+ED":
        expected = image[..., -1:] / alpha.clamp(min=1e-10)
        image = torch.cat([image[..., :-1], expected], dim=-1)
    radii = torch.stack([view.radii for view in seen])
    return image, alpha, {"means2d": centres, "radii": radii, "gaussian_ids": None}


class See:
    """What one camera sees."""

    def __init__(self, splats: Splats, camera: Cameras, settings: RenderSettings) -> None:
        self.camera, self.settings = camera, settings
        with torch.no_grad():
            everything = project(splats, camera, settings)
            visible, extents = visible_extents(everything, camera, settings)
        rows = visible.nonzero()[:, 0]
        self.rows = rows[everything.depths[rows].argsort(stable=True)]
        self.ellipses: Ellipses = project(splats, camera, settings, self.rows)
        self.radii = torch.where(visible[:, None], extents, 0.0).ceil().int()
        # Where nothing is visible the real one leaves whatever was in memory.
        unset = torch.full_like(everything.means, torch.nan)
        self.centres = unset.index_copy(0, self.rows, self.ellipses.means)

    def paint(
        self, channels: Tensor, index: int, centres: Tensor, absgrad: bool
    ) -> tuple[Tensor, Tensor]:
        ellipses = replace(self.ellipses, means=centres[index].index_select(0, self.rows))
        profile = self.settings.profile
        with torch.no_grad():
            bins = bin_ellipses(ellipses, self.camera, profile, 1000.0)
            wanted = centres.new_zeros(0) if absgrad else None
            rows, half_size = self.rows, centres.new_ones(2)
            measured = Absolute(rows, half_size, None, wanted, None, None, index, centres)
            cut_offs = CutOffs.of(profile, channels.dtype)
            buffer = TileBuffer(bins, bins.inside(self.camera), cut_offs, 4.0, measured)
        return blend(projected_splats(ellipses, channels), buffer, self.camera)


def _channels(
    splats: Splats, colors: Tensor, sh_degree: int | None, view: See, index: int
) -> Tensor:
    if sh_degree is not None:
        harmonics = replace(splats, colors=Sh(colors, sh_degree))
        return view_colors(harmonics, view.camera, view.rows)
    return (colors if colors.dim() == 2 else colors[index]).index_select(0, view.rows)
