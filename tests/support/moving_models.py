"""Small models of every moving method, of random parameters: they move, turn and fade."""

import torch

from gsfw.core.model import PrimitiveModel
from gsfw.kernels.cpu.operators import CpuOperators
from gsfw.methods.gaussians4d.config import DeformationConfig, HashConfig, HexPlaneConfig, MlpConfig
from gsfw.methods.rotor4d.config import SlicedGaussiansConfig
from support.moving_splats import moving_scene, seeded, spacetime
from support.scenes import random_splats
from support.tracked_splats import after

TENTHS = tuple(index / 10 for index in range(11))
"""Times of the scene."""


def sliced(rotation: str = "rotor") -> PrimitiveModel:
    """Slices of tilted Gaussians in four dimensions."""
    config = SlicedGaussiansConfig(sh_degree=1, init_duration=0.3, rotation=rotation)
    model = config.build().build_model(
        moving_scene(), CpuOperators(), seeded(), random_splats(20, degree=1)
    )
    with torch.no_grad():
        time_quats = model.columns()["time_quats"].values
        time_quats += 0.5 * torch.randn(time_quats.shape, generator=seeded(1))
        model.columns()["time_centers"].values.uniform_(-0.2, 1.2, generator=seeded(2))
    model.project_()
    return model


def deformed(encoder: str, **options) -> PrimitiveModel:
    """Gaussians that a field moves, turns, stretches, fades and recolours."""
    config = DeformationConfig(
        sh_degree=1,
        encoder=encoder,
        deform_opacity=True,
        deform_sh=True,
        hexplane=HexPlaneConfig(channels=8, resolution=4, width=6),
        mlp=MlpConfig(width=6, depth=3, frequencies=2, time_frequencies=2),
        hash=HashConfig(levels=2, features=3, log2_rows=8, coarsest=2, finest=6, width=6),
        **options,
    )
    model = config.build().build_model(moving_scene(), CpuOperators(), seeded(), None).double()
    with torch.no_grad():
        for parameter in model.parameters():
            noise = torch.randn(parameter.shape, generator=seeded(3), dtype=parameter.dtype)
            parameter.add_(0.1 * noise)
    return model


MODELS = {
    "spacetime": spacetime,
    "adaptive": lambda: spacetime(motion="adaptive"),
    "features": lambda: spacetime(colors="features"),
    "of degree 5": lambda: spacetime(motion_order=5),
    "freetime": lambda: spacetime(motion_order=1, spin=False),
    "rotor4d": sliced,
    "two quaternions": lambda: sliced("two-quaternions"),
    "hexplane": lambda: deformed("hexplane"),
    "mlp": lambda: deformed("mlp"),
    "hash": lambda: deformed("hash"),
    "with still rows": lambda: deformed("hexplane", static="auto"),
    "dynamic3d": lambda: after(TENTHS),
}
IN_CLOSED_FORM = ("spacetime", "adaptive", "features", "freetime", "rotor4d", "two quaternions")
"""Those whose motion is of the form that files hold."""
