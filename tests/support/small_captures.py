"""Small captures on disk: cameras on a ring that look at known points, in every format."""

import json
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from gsfw.core.datamanager import DataManager, DataRequest, Split
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.colmap.model import CAMERA_MODELS

WIDTH, HEIGHT = 64, 48
FOCAL = (70.0, 72.0)
CENTER = (31.0, 25.5)
MODEL_NUMBERS = {name: number for number, (name, _) in enumerate(CAMERA_MODELS)}


@dataclass(frozen=True)
class SmallCapture:
    """Poses (world to camera, OpenCV axes), points and colours, the images' names, and the lens."""

    poses: list[np.ndarray]
    points: np.ndarray
    names: list[str]
    colors: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.uint8))
    focal: tuple[float, float] = FOCAL
    center: tuple[float, float] = CENTER

    def pixels(self, view: int, scale: float = 1.0) -> np.ndarray:
        """Where the points fall into an image, computed in float64 from the poses alone."""
        local = self.points @ self.poses[view][:3, :3].T + self.poses[view][:3, 3]
        return scale * (np.array(self.focal) * local[:, :2] / local[:, 2:] + np.array(self.center))


def ring(views: int = 4, size: float = 1.0, origin=(0.0, 0.0, 0.0)) -> SmallCapture:
    """Cameras at distance ``size`` around ``origin``, and points near it."""
    generator = np.random.default_rng(7)
    origin = np.array(origin)
    poses = []
    for angle in 2 * np.pi * (np.arange(views) + 0.3) / views:
        center = origin + size * np.array([np.cos(angle), np.sin(angle), 0.4])
        forward = (origin - center) / np.linalg.norm(origin - center)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, -rotation @ center
        poses.append(pose)
    points = origin + 0.3 * size * generator.uniform(-1, 1, (20, 3))
    names = [f"view_{index:03d}.png" for index in range(views)]
    return SmallCapture(poses, points, names, generator.integers(0, 256, (20, 3)).astype(np.uint8))


def square(capture):
    """The same for programs that know one focal length."""
    return replace(capture, focal=(FOCAL[0], FOCAL[0]))


def write_image(path: Path, width: int = WIDTH, height: int = HEIGHT, mode: str = "RGB") -> None:
    """An image of a gradient."""
    path.parent.mkdir(parents=True, exist_ok=True)
    channels = len(mode)
    values = (np.arange(width * height * channels) * 7 % 256).astype(np.uint8)
    shape = (height, width) if channels == 1 else (height, width, channels)
    Image.fromarray(values.reshape(shape), mode).save(path)


def write_images(folder: Path, capture: SmallCapture, width=WIDTH, height=HEIGHT) -> None:
    """One image for each view."""
    for name in capture.names:
        write_image(folder / name, width, height)


def write_colmap(
    folder: Path, capture: SmallCapture, suffix: str = ".bin", model: str = "PINHOLE", params=None
) -> Path:
    """A COLMAP model of one camera; tracks are empty."""
    folder.mkdir(parents=True, exist_ok=True)
    params = params or (*FOCAL, *CENTER)
    writer = {".bin": _write_binary, ".txt": _write_text}[suffix]
    writer(folder, capture, {1: (model, WIDTH, HEIGHT, params)}, [1] * len(capture.names))
    return folder


def write_colmap_cameras(folder: Path, capture: SmallCapture, cameras: dict, used: list) -> None:
    """A binary COLMAP model of several cameras: number -> (model, width, height, parameters)."""
    folder.mkdir(parents=True, exist_ok=True)
    _write_binary(folder, capture, cameras, used)


def _write_binary(folder, capture, cameras, used):
    content = struct.pack("<Q", len(cameras))
    for number, (model, width, height, params) in cameras.items():
        content += struct.pack("<iiQQ", number, MODEL_NUMBERS[model], width, height)
        content += struct.pack(f"<{len(params)}d", *params)
    (folder / "cameras.bin").write_bytes(content)
    content = struct.pack("<Q", len(capture.names))
    for number, (pose, name) in enumerate(zip(capture.poses, capture.names, strict=True), 1):
        content += struct.pack("<i7di", number, *_quaternion(pose), *pose[:3, 3], used[number - 1])
        content += name.encode() + b"\0" + struct.pack("<Q", 1) + struct.pack("<ddq", 1, 2, -1)
    (folder / "images.bin").write_bytes(content)
    content = struct.pack("<Q", len(capture.points))
    for number, (point, color) in enumerate(zip(capture.points, capture.colors, strict=True), 1):
        track = number % 3
        content += struct.pack("<Q3d3BdQ", number, *point, *color, 0.5, track) + bytes(8 * track)
    (folder / "points3D.bin").write_bytes(content)


def _write_text(folder, capture, cameras, used):
    lines = ["# a comment"]
    for number, (model, width, height, params) in cameras.items():
        lines.append(f"{number} {model} {width} {height} {_numbers(params)}")
    (folder / "cameras.txt").write_text("\n".join(lines) + "\n")
    lines = ["# a comment"]
    for number, (pose, name) in enumerate(zip(capture.poses, capture.names, strict=True), 1):
        values = _numbers((*_quaternion(pose), *pose[:3, 3]))
        lines += [
            f"{number} {values} {used[number - 1]} {name}",
            "1.5 2.5 -1" if number % 2 else "",
        ]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    lines = ["# a comment"]
    for number, (point, color) in enumerate(zip(capture.points, capture.colors, strict=True), 1):
        track = " 1 2" * (number % 2)
        lines.append(f"{number} {_numbers(point)} {' '.join(map(str, color))} 0.5{track}")
    (folder / "points3D.txt").write_text("\n".join(lines) + "\n")


def _numbers(values) -> str:
    return " ".join(repr(float(value)) for value in values)


def _quaternion(pose: np.ndarray) -> np.ndarray:
    """Unit quaternion wxyz of a rotation, as the eigenvector of Bar-Itzhack's matrix (2000)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = pose[:3, :3]
    matrix = np.array(
        [
            [xx - yy - zz, yx + xy, zx + xz, zy - yz],
            [yx + xy, yy - xx - zz, zy + yz, xz - zx],
            [zx + xz, zy + yz, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    x, y, z, w = np.linalg.eigh(matrix / 3)[1][:, -1]
    return np.array([w, x, y, z])


def rotation_vector(rotation: np.ndarray) -> list[float]:
    """The vector of a rotation matrix: its axis, as long as its angle in radians."""
    angle = np.arccos((np.trace(rotation) - 1) / 2)
    pairs = ((2, 1), (0, 2), (1, 0))
    axis = np.array([rotation[i, j] - rotation[j, i] for i, j in pairs])
    return (angle * axis / (2 * np.sin(angle))).tolist()


def opengl(pose: np.ndarray) -> list:
    """The camera-to-world matrix with OpenGL axes that transforms.json files hold."""
    return (np.linalg.inv(pose) @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist()


def write_transforms(path: Path, capture: SmallCapture, frame_settings=(), **settings) -> Path:
    """A transforms.json; ``settings`` replace those of the whole file, None removes one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {
        "fl_x": FOCAL[0], "fl_y": FOCAL[1], "cx": CENTER[0], "cy": CENTER[1],
        "w": WIDTH, "h": HEIGHT,
    }  # fmt: skip
    content = {key: value for key, value in (content | settings).items() if value is not None}
    content["frames"] = [
        {"file_path": name, "transform_matrix": opengl(pose)}
        | (frame_settings[index] if frame_settings else {})
        for index, (pose, name) in enumerate(zip(capture.poses, capture.names, strict=True))
    ]
    path.write_text(json.dumps(content))
    return path


def request(path: Path, **settings) -> DataRequest:
    """A request that holds nothing out, unless told otherwise."""
    return replace(DataRequest(path, eval_every_nth=0), **settings)


def builder_of(kind: Callable[..., CaptureConfig]) -> Callable[..., DataManager]:
    """A function that builds a data set of a format, with settings of it and of the request."""

    def build(path: Path, config: Mapping[str, object] | None = None, **settings) -> DataManager:
        return kind(**config or {}).build(request(path, **settings))

    return build


def projection_error(data: DataManager, capture: SmallCapture, scale: float = 1.0) -> float:
    """Pixels between where loaded cameras see the points and where they should; worst of all."""
    points = torch.from_numpy(capture.points)
    local = data.scene.world_from_scene.inverse().apply(points).float()
    worst = 0.0
    for split in Split:
        views = data.views(split)
        for name, camera in zip(views.names, views.cameras, strict=True):
            pose, intrinsics = camera.world_to_camera[0], camera.intrinsics[0]
            seen = (local @ pose[:3, :3].T + pose[:3, 3]) @ intrinsics.T
            wanted = torch.from_numpy(capture.pixels(capture.names.index(name), scale))
            worst = max(worst, float((seen[:, :2] / seen[:, 2:] - wanted).abs().max()))
    return worst
