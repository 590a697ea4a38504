"""Footprint: how far one pixel reaches at a point, across the ray that leads there.

Splatting projects by the derivative J of pixels by points and then adds 0.3 I pixels squared to
J Sigma J^T (Kerbl et al. 2023, equation 5). J knows nothing of the direction of the ray, so that
J^+ = J^T (J J^T)^-1, which moves points across the ray only, undoes it there: Sigma + 0.3 J^+ J^+T
has exactly that projection, J (Sigma + 0.3 J^+ J^+T) J^T = J Sigma J^T + 0.3 I.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.maths.lens import project_points


def pixel_steps(points: Float[Tensor, "m 3"], camera: Cameras) -> Float[Tensor, "m 3 2"]:
    """J^+: where a point goes, across its ray, when its image moves by a pixel in x or in y.

    Args:
        points: of positive depth, in camera axes.
        camera: one camera.

    Returns:
        Scene units per pixel.
    """
    focal = camera.intrinsics[0].diagonal()[:2]
    if camera.model is CameraModel.ORTHOGRAPHIC:
        steps = torch.cat([(1 / focal).diag(), focal.new_zeros(1, 2)])
        return steps.expand(len(points), 3, 2)
    # At depth 1 and focal length 1, of which the rest is multiples, nothing overflows.
    depths = points[:, 2:]
    identity = torch.eye(3, dtype=points.dtype, device=points.device)[None]
    _, jacobian = project_points(
        points / depths, replace(camera, intrinsics=identity), margin=torch.inf
    )
    first, second = jacobian.unbind(1)
    normal = torch.linalg.cross(first, second)
    across = [torch.linalg.cross(second, normal), torch.linalg.cross(normal, first)]
    inverse = torch.stack(across, dim=2) / normal.square().sum(1)[:, None, None]
    return inverse * depths[:, :, None] / focal
