"""The shared mathematics, compiled once per test session with the machine's own compiler."""

import ctypes
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.numerics import DEPTH_MIN, LENGTH_MAX, QUATERNION_MIN_NORM
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats

HEADERS = Path(__file__).resolve().parents[3] / "kernels" / "shared"

MODELS = list(CameraModel)
"""In the order that camera.h numbers them."""


@dataclass(frozen=True)
class Maths:
    """The compiled functions for one number type."""

    library: ctypes.CDLL
    kind: str
    """float, double or pair."""

    @property
    def dtype(self) -> torch.dtype:
        return torch.float32 if self.kind == "float" else torch.float64

    def call(
        self, name: str, inputs: list[Tensor], columns: int, *uniform: Tensor | float
    ) -> Tensor:
        """Rows of results [n, columns] of a function in library.cpp.

        Args:
            name: without the number type.
            inputs: arrays of n rows.
            columns: of the result.
            uniform: what comes before the arrays: numbers, or tensors that become doubles.
        """
        rows = [tensor.detach().to(self.dtype).contiguous() for tensor in inputs]
        shared = [value.double() if isinstance(value, Tensor) else value for value in uniform]
        n = len(rows[0])
        assert self.kind != "pair" or n % 2 == 0
        result = torch.full((n, columns), torch.nan, dtype=self.dtype)
        arguments: list[object] = [ctypes.c_int(n)]
        for value in [*shared, *rows, result]:
            if isinstance(value, Tensor):
                arguments.append(ctypes.c_void_p(value.data_ptr()))
            else:
                kind = ctypes.c_int if isinstance(value, int) else ctypes.c_double
                arguments.append(kind(value))
        getattr(self.library, f"{name}_{self.kind}")(*arguments)
        return result

    def project(self, splats: Splats, camera: Cameras, settings: RenderSettings) -> Tensor:
        """Mean, depth, covariance (xx, xy, yy), determinant, opacity, visible, extents: [n, 11]."""
        uniform = _camera_numbers(camera, settings), _settings_numbers(settings)
        return self.call(f"project_{_form(splats)}", [_rows(splats)], 11, *uniform)

    def project_vjp(
        self, splats: Splats, camera: Cameras, settings: RenderSettings, gradients: Tensor
    ) -> dict[str, Tensor]:
        """The gradient of every input, by name; the pose's is summed over the splats.

        Args:
            splats: n of them.
            camera: one.
            settings: of the render.
            gradients: [n, 7]: dL/d mean, depth; second moments; dL/d opacity.
        """
        uniform = _camera_numbers(camera, settings), _settings_numbers(settings)
        rows = _rows(splats)
        name, columns = f"project_{_form(splats)}_vjp", rows.shape[1] + 12
        result = self.call(name, [rows, gradients], columns, *uniform)
        mean, shape, opacity, rotation, translation = result.split(
            [3, rows.shape[1] - 4, 1, 9, 3], dim=1
        )
        pose = torch.cat([rotation.view(-1, 3, 3), translation[:, :, None]], dim=2).sum(0)
        named = {"means": mean, "opacities": opacity[:, 0], "pose": pose}
        if splats.covariances is None:
            return named | {"quats": shape[:, :4], "scales": shape[:, 4:]}
        return named | {"covariances": shape[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].view(-1, 3, 3)}

    def see(
        self, points: Tensor, camera: Cameras, settings: RenderSettings, gradients: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Pixels, Jacobians and dL/d point, from dL/d pixel and dL/d Jacobian [n, 8]."""
        numbers = _camera_numbers(camera, settings)
        result = self.call("see", [points, gradients], 11, numbers)
        return result[:, :2], result[:, 2:8].view(-1, 2, 3), result[:, 8:]

    def camera_center(self, camera: Cameras, gradients: Tensor) -> tuple[Tensor, Tensor]:
        """Camera centres, and dL/d pose [n, 3, 4] from dL/d centre [n, 3]."""
        numbers = _camera_numbers(camera, RenderSettings())
        result = self.call("center", [gradients], 15, numbers)
        rotation, translation = result[:, 3:12].view(-1, 3, 3), result[:, 12:, None]
        return result[:, :3], torch.cat([rotation, translation], dim=2)


def _form(splats: Splats) -> str:
    return "axes" if splats.covariances is None else "covariance"


def _rows(splats: Splats) -> Tensor:
    """Mean, shape and opacity of each splat."""
    if splats.covariances is None:
        assert splats.quats is not None
        assert splats.scales is not None
        shape = [splats.quats, splats.scales]
    else:
        halves = 0.5 * (splats.covariances + splats.covariances.transpose(1, 2))
        shape = [halves.flatten(1)[:, [0, 1, 2, 4, 5, 8]]]
    return torch.cat([splats.means, *shape, splats.opacities[:, None]], dim=1)


def _camera_numbers(camera: Cameras, settings: RenderSettings) -> Tensor:
    """One camera as library.cpp reads it."""
    margin = settings.profile.jacobian_margin
    world_to_camera, intrinsics = camera.world_to_camera[0].detach(), camera.intrinsics[0]
    return torch.cat(
        [
            torch.tensor([float(MODELS.index(camera.model))]),
            world_to_camera[:3, :3].reshape(-1),
            world_to_camera[:3, 3],
            intrinsics.diagonal()[:2],
            intrinsics[:2, 2],
            torch.tensor([camera.width, camera.height, margin], dtype=torch.float64),
        ]
    ).double()


def _settings_numbers(settings: RenderSettings) -> Tensor:
    """Settings as library.cpp reads them."""
    profile = settings.profile
    near = max(settings.near, DEPTH_MIN)
    numbers = [profile.dilation, profile.compensation_min, profile.alpha_min, near, settings.far]
    numbers += [LENGTH_MAX, QUATERNION_MIN_NORM, settings.antialias, profile.alpha_min > 0]
    return torch.tensor(numbers, dtype=torch.float64)


@pytest.fixture(scope="session")
def headers() -> Path:
    return HEADERS


@pytest.fixture(scope="session")
def compiler() -> str:
    found = shutil.which(os.environ.get("CXX", "c++"))
    if found is None:
        pytest.skip("there is no C++ compiler on this machine to build the shared mathematics with")
    return found


@pytest.fixture(scope="session")
def library(compiler: str, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    out = tmp_path_factory.mktemp("maths") / "maths.so"
    source = Path(__file__).with_name("library.cpp")
    # Without contraction a pack gives the same bits as single numbers.
    options = ["-std=c++17", "-O1", "-ffp-contract=off", "-fno-math-errno", "-shared", "-fPIC"]
    subprocess.run([compiler, *options, f"-I{HEADERS}", str(source), "-o", str(out)], check=True)
    return ctypes.CDLL(str(out))


@pytest.fixture
def single(library: ctypes.CDLL) -> Maths:
    return Maths(library, "float")


@pytest.fixture
def double(library: ctypes.CDLL) -> Maths:
    return Maths(library, "double")


@pytest.fixture
def pair(library: ctypes.CDLL) -> Maths:
    return Maths(library, "pair")
