"""Sound captures: a tiny data set of each data manager, to be damaged.

Cameras stand on a ring and see 20 points (tests/support/small_captures.py). Optional parts, such as
masks, depth maps, points and distortion, are there so that their readers are reached.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from support.small_captures import (
    CENTER,
    FOCAL,
    HEIGHT,
    WIDTH,
    SmallCapture,
    opengl,
    ring,
    write_colmap,
    write_image,
    write_images,
    write_transforms,
)
from support.small_videos import cameras, write_video

from gsfw.datamanagers.point_file import ply_of
from gsfw.partition.cells import Cell
from gsfw.partition.document import Block, Partition, write_partition
from gsfw.partition.ground import Ground

VIEWS, TIMES = 3, 3
SIZE = {"width": WIDTH, "height": HEIGHT}
K = [[FOCAL[0], 0.0, CENTER[0]], [0.0, FOCAL[1], CENTER[1]], [0.0, 0.0, 1.0]]
DISTORTION = {"k1": -0.1, "k2": 0.05, "p1": 2e-3, "p2": -3e-3}

Writer = Callable[[Path], str]
"""Writes a data set into a folder; gives the path in it that is read."""


def _json(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def _points(path: Path, capture: SmallCapture) -> None:
    import torch

    positions = torch.from_numpy(capture.points)
    path.write_bytes(ply_of(positions, torch.from_numpy(capture.colors) / 255))


def _center(pose: np.ndarray) -> list[float]:
    return [float(value) for value in -pose[:3, :3].T @ pose[:3, 3]]


def _axis_angle(rotation: np.ndarray) -> list[float]:
    angle = np.arccos((np.trace(rotation) - 1) / 2)
    pairs = ((2, 1), (0, 2), (1, 0))
    axis = np.array([rotation[i, j] - rotation[j, i] for i, j in pairs])
    return [float(value) for value in angle * axis / (2 * np.sin(angle))]


def colmap_binary(folder: Path) -> str:
    """A binary model with a distorted lens, and a mask of one image."""
    capture = ring(VIEWS)
    lens = (*FOCAL, *CENTER, *DISTORTION.values())
    write_colmap(folder / "sparse/0", capture, model="OPENCV", params=lens)
    write_images(folder / "images", capture)
    write_image(folder / "masks" / capture.names[0], mode="L")
    return "."


def colmap_text(folder: Path) -> str:
    """A model as text."""
    write_colmap(folder / "sparse/0", ring(VIEWS), ".txt")
    write_images(folder / "images", ring(VIEWS))
    return "."


def transforms(folder: Path) -> str:
    """With masks, depth maps, times, camera numbers, a split and points."""
    capture = ring(VIEWS)
    settings = [
        {"mask_path": "mask.png", "depth_file_path": f"{n}.npy", "time": n / 2, "camera_index": n}
        for n in range(VIEWS)
    ]
    lists = {"train_filenames": capture.names[1:], "test_filenames": capture.names[:1]}
    write_transforms(
        folder / "transforms.json", capture, settings, ply_file_path="p.ply", **lists, **DISTORTION
    )
    write_images(folder, capture)
    write_image(folder / "mask.png", mode="L")
    for number in range(VIEWS):
        np.save(folder / f"{number}.npy", np.full((HEIGHT, WIDTH), 900, np.uint16))
    _points(folder / "p.ply", capture)
    return "."


def blender(folder: Path) -> str:
    """As NeRF-synthetic, with times."""
    for split, members in (("train", (0, 1)), ("test", (2,))):
        whole = ring(VIEWS)
        names = [f"./{split}/r_{index}" for index in members]
        part = replace(whole, poses=[whole.poses[index] for index in members], names=names)
        for name in names:
            write_image(folder / f"{name}.png", mode="RGBA")
        times = [{"time": index / 2} for index in members]
        write_transforms(folder / f"transforms_{split}.json", part, times, camera_angle_x=0.9)
    return "."


def _pose_bounds(capture: SmallCapture) -> np.ndarray:
    rows = []
    for pose in capture.poses:
        right, down, forward = pose[:3, :3]
        columns = [down, right, -forward, np.array(_center(pose)), [HEIGHT, WIDTH, FOCAL[0]]]
        rows.append([*np.stack(columns, axis=1).flatten(), 0.5, 3.0])
    return np.array(rows)


def llff(folder: Path) -> str:
    """Poses and bounds of images."""
    write_images(folder / "images", ring(VIEWS))
    np.save(folder / "poses_bounds.npy", _pose_bounds(ring(VIEWS)))
    return "."


def metashape(folder: Path) -> str:
    """A chunk with a place in the world, a distorted lens, and points."""
    capture = ring(VIEWS)
    size = f'<resolution width="{WIDTH}" height="{HEIGHT}"/>'
    terms = "<f>70</f><cx>-1</cx><cy>1.5</cy><b1>-2</b1><k1>-0.1</k1><p1>0.002</p1>"
    lens = f'<calibration type="frame" class="adjusted">{size}{terms}</calibration>'
    placed = (
        "<transform><rotation>0 -1 0 1 0 0 0 0 1</rotation><translation>3 -4 5</translation>"
        "<scale>2.5</scale></transform>"
    )
    shots = "".join(
        f'<camera id="{n}" sensor_id="0" component_id="0" label="{name.removesuffix(".png")}">'
        f"<transform>{' '.join(map(repr, map(float, np.linalg.inv(pose).flatten())))}</transform>"
        "</camera>"
        for n, (pose, name) in enumerate(zip(capture.poses, capture.names, strict=True))
    )
    (folder / "cameras.xml").write_text(
        '<?xml version="1.0" encoding="UTF-8"?><document version="1.5.0"><chunk label="Chunk 1">'
        f'<sensors><sensor id="0" label="unknown" type="frame">{size}{lens}</sensor></sensors>'
        f'<components><component id="0">{placed}</component></components>'
        f"<cameras>{shots}</cameras>{placed}</chunk></document>"
    )
    write_images(folder / "images", capture)
    _points(folder / "points.ply", capture)
    return "."


def reality_capture(folder: Path) -> str:
    """Rows with every term of the lens."""
    capture = ring(VIEWS)
    rows = ["#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"]
    for number, (pose, name) in enumerate(zip(capture.poses, capture.names, strict=True)):
        angles = (100.0 * number, 70.0, 0.5)
        values = (*_center(pose), *angles, 39.4, 0.0, 0.02, -0.1, 0.05, 0.0, 0.0, 0.002, -0.003)
        rows.append(",".join([name, *map(repr, values)]))
    (folder / "export.csv").write_text("\n".join(rows) + "\n")
    write_images(folder / "images", capture)
    return "."


def polycam(folder: Path) -> str:
    """Keyframes with their cameras."""
    capture = ring(VIEWS)
    for pose, name in zip(capture.poses, capture.names, strict=True):
        matrix = np.array(opengl(pose))
        lens = {"fx": FOCAL[0], "fy": FOCAL[1], "cx": CENTER[0], "cy": CENTER[1], **SIZE}
        content = lens | {f"t_{i}{j}": matrix[i, j] for i in range(3) for j in range(4)}
        stem = Path(name).stem
        _json(folder / f"keyframes/cameras/{stem}.json", content | {"blur_score": 60.0})
    write_images(folder / "keyframes/images", capture)
    return "."


def record3d(folder: Path) -> str:
    """An export, half a turn around x for each pose."""
    poses = [[1.0, 0.0, 0.0, 0.0, *_center(pose)] for pose in ring(VIEWS).poses]
    content = {"w": WIDTH, "h": HEIGHT, "K": [FOCAL[0], 0, 0, 0, FOCAL[1], 0, *CENTER, 1]}
    _json(folder / "metadata.json", content | {"poses": poses})
    names = [f"{number}.png" for number in range(VIEWS)]
    write_images(folder / "rgb", replace(ring(VIEWS), names=names))
    return "."


def opensfm(folder: Path) -> str:
    """A reconstruction with a lens of Brown, and points."""
    capture, longer = ring(VIEWS), max(WIDTH, HEIGHT)
    lens = {"projection_type": "brown", **SIZE, "focal_x": FOCAL[0] / longer}
    lens |= {"focal_y": FOCAL[1] / longer, "c_x": 0.0, "c_y": 0.02, "k3": 0.0, **DISTORTION}
    shots = {
        name: {
            "camera": "v2",
            "rotation": _axis_angle(pose[:3, :3]),
            "translation": pose[:3, 3].tolist(),
        }
        for pose, name in zip(capture.poses, capture.names, strict=True)
    }
    points = {
        str(number): {"coordinates": point.tolist(), "color": color.tolist()}
        for number, (point, color) in enumerate(zip(capture.points, capture.colors, strict=True))
    }
    content = [{"cameras": {"v2": lens}, "shots": shots, "points": points}]
    _json(folder / "reconstruction.json", content)
    write_images(folder / "images", capture)
    return "."


def _wrapped(key: int, data: Mapping[str, Any], identifier: int, **more: str) -> dict[str, Any]:
    """An entry as the library cereal writes pointers to classes."""
    wrapper = {"id": 2147483649 + key, "data": data}
    return {"key": key, "value": {"polymorphic_id": identifier, **more, "ptr_wrapper": wrapper}}


def openmvg(folder: Path) -> str:
    """Views, a radial lens, poses and points."""
    capture = ring(VIEWS)
    views = [
        {"local_path": "", "filename": name, **SIZE, "id_view": n, "id_intrinsic": 0, "id_pose": n}
        for n, name in enumerate(capture.names)
    ]
    poses = [{"rotation": pose[:3, :3].tolist(), "center": _center(pose)} for pose in capture.poses]
    lens = SIZE | {"focal_length": FOCAL[0], "principal_point": list(CENTER)}
    lens |= {"disto_k3": [-0.1, 0.05, 0.0]}
    kind = "pinhole_radial_k3"
    content = {
        "sfm_data_version": "0.3",
        "root_path": "images",
        "views": [_wrapped(number, view, 1073741824) for number, view in enumerate(views)],
        "intrinsics": [_wrapped(0, lens, 2147483649, polymorphic_name=kind)],
        "extrinsics": [{"key": number, "value": pose} for number, pose in enumerate(poses)],
        "structure": [
            {"key": number, "value": {"X": point.tolist(), "observations": []}}
            for number, point in enumerate(capture.points)
        ],
    }
    _json(folder / "sfm_data.json", content)
    write_images(folder / "images", capture)
    return "."


def nerfies(folder: Path) -> str:
    """Cameras, times, a split and points."""
    capture = ring(VIEWS)
    names = [f"left1_{number:06d}" for number in range(VIEWS)]
    for name, pose in zip(names, capture.poses, strict=True):
        content = {
            "orientation": pose[:3, :3].tolist(),
            "position": _center(pose),
            **{"focal_length": FOCAL[0], "principal_point": CENTER, "skew": 0.0},
            **{"pixel_aspect_ratio": 1.03, "radial_distortion": [0.01, 0.0, 0.0]},
            **{"tangential_distortion": [0.0, 0.0], "image_size": [WIDTH, HEIGHT]},
        }
        _json(folder / f"camera/{name}.json", content)
        write_image(folder / f"rgb/1x/{name}.png")
    lists = {"count": VIEWS, "ids": names, "train_ids": names[1:], "val_ids": names[:1]}
    _json(folder / "dataset.json", lists)
    times = {name: {"warp_id": 3 * n, "camera_id": n % 2} for n, name in enumerate(names)}
    _json(folder / "metadata.json", times)
    place = {"scale": 0.02, "center": [1.0, 2.0, 3.0], "near": 0.1, "far": 2.0}
    _json(folder / "scene.json", place)
    np.save(folder / "points.npy", capture.points.astype(np.float32))
    return "."


def neural_3d_folders(folder: Path) -> str:
    """Images of each camera in folders."""
    capture = cameras(VIEWS)
    for name in capture.names:
        for time in range(TIMES):
            write_image(folder / name / f"images/{time:04d}.png")
    np.save(folder / "poses_bounds.npy", _pose_bounds(capture))
    return "."


def neural_3d_videos(folder: Path) -> str:
    """A video of each camera."""
    capture = cameras(VIEWS)
    for name in capture.names:
        write_video(folder / f"{name}.mp4", TIMES)
    np.save(folder / "poses_bounds.npy", _pose_bounds(capture))
    return "."


def panoptic(folder: Path) -> str:
    """Two lists of cameras, masks of what moves, and points."""
    capture = cameras(VIEWS)
    for file, own in (("train_meta.json", (0, 1)), ("test_meta.json", (2,))):
        names = [[f"{10 + c}/{time:06d}.jpg" for c in own] for time in range(TIMES)]
        content = {"w": WIDTH, "h": HEIGHT, "k": [[K for _ in own]] * TIMES, "fn": names}
        content["w2c"] = [[capture.poses[c].tolist() for c in own]] * TIMES
        _json(folder / file, content | {"cam_id": [[10 + c for c in own]] * TIMES})
        for name in (name for at_once in names for name in at_once):
            write_image(folder / "ims" / name)
            seg = (folder / "seg" / name).with_suffix(".png")
            seg.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(np.full((HEIGHT, WIDTH), 255, np.uint8)).save(seg)
    points = capture.points
    cloud = np.concatenate([points, np.full((20, 3), 0.25), np.ones((20, 1))], axis=1)
    np.savez(folder / "init_pt_cld.npz", data=cloud)
    return "."


def colmap_per_frame(folder: Path) -> str:
    """Two times, with a model of each."""
    capture = replace(ring(VIEWS), names=[f"cam{number:02d}.png" for number in range(VIEWS)])
    for time in range(2):
        write_colmap(folder / f"colmap_{time}/sparse/0", capture)
        write_images(folder / f"colmap_{time}/images", capture)
    return "."


def _calibrated(folder: Path, file: str) -> None:
    capture = cameras(VIEWS)
    entries = [
        {"name": name, "w": WIDTH, "h": HEIGHT, "K": K, "dist": [0.1, 0.0, 0.0, 0.0]}
        | {"w2c": pose.tolist()}
        for name, pose in zip(capture.names, capture.poses, strict=True)
    ]
    if file.endswith(".json"):
        _json(folder / file, {"cameras": entries})
        return
    tables = [
        f'[{entry["name"]}]\nname = "{entry["name"]}"\nsize = [{WIDTH}.0, {HEIGHT}.0]\n'
        f"matrix = {K}\ndistortions = {entry['dist']}\nfisheye = false\n"
        f"rotation = {_axis_angle(pose[:3, :3])}\ntranslation = {pose[:3, 3].tolist()}\n"
        for entry, pose in zip(entries, capture.poses, strict=True)
    ]
    (folder / file).write_text("\n".join(tables))


def synchronised_json(folder: Path) -> str:
    """Videos, and a calibration as JSON."""
    _calibrated(folder, "cameras.json")
    for name in cameras(VIEWS).names:
        write_video(folder / f"videos/{name}.mp4", TIMES)
    return "."


def synchronised_toml(folder: Path) -> str:
    """Videos, and a calibration as TOML."""
    _calibrated(folder, "Calib.toml")
    for name in cameras(VIEWS).names:
        write_video(folder / f"videos/{name}.mp4", TIMES)
    return "."


def blocks(folder: Path) -> str:
    """A partition into two blocks, and the data set beside it."""
    transforms(folder / "data")
    names = tuple(ring(VIEWS).names)
    sides = (Cell(high=(0.0, math.inf)), Cell(low=(0.0, -math.inf)))
    halves = tuple(
        Block(f"block-{n}", cell, 0.1, names[1:], names[:1], 10, 100, 50.0)
        for n, cell in enumerate(sides)
    )
    ground = Ground(np.zeros(3), np.eye(3))
    settings = {"blank_pixels": 0.5}
    made = Partition(
        folder / "data", "transforms", settings, ground, names[:1], "every 8th by name", halves
    )
    (folder / "cut").mkdir()
    # It states where the data set lies, which is not where it will be read.
    path = write_partition(folder / "cut", made)
    path.write_text(path.read_text().replace(str((folder / "data").resolve()), "/nowhere"))
    return "cut"


CAPTURES: Mapping[str, tuple[Writer, ...]] = {
    "colmap": (colmap_binary, colmap_text),
    "transforms": (transforms,),
    "blender": (blender,),
    "llff": (llff,),
    "metashape": (metashape,),
    "reality-capture": (reality_capture,),
    "polycam": (polycam,),
    "record3d": (record3d,),
    "opensfm": (opensfm,),
    "openmvg": (openmvg,),
    "nerfies": (nerfies,),
    "neural-3d-video": (neural_3d_folders, neural_3d_videos),
    "panoptic": (panoptic,),
    "colmap-per-frame": (colmap_per_frame,),
    "blocks": (blocks,),
    "synchronised-videos": (synchronised_json, synchronised_toml),
}
"""Writers of sound data sets by the name of their data manager."""
