"""Sound files of gsfw itself: runs, checkpoints, settings, studies, paths, edits, notes of work."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable, Mapping
from pathlib import Path

import torch
from PIL import Image
from support.report_runs import write_run
from support.small_captures import ring

from gsfw.core.loop.run_folder import RunFolder
from gsfw.rendering.key_frames import CameraPath, KeyFrame, write_camera_path
from gsfw.studies.result import Failure, Result, ResultStore

STUDY = """
title: Things that move
about: Two methods, one scene.
settings: &usual {steps: 10, optim: {sparse: true}}
seeds: [1, 2]
rows:
  3dgs: {method: 3dgs, ignore_time: true}
  4dgs: {<<: *usual, method: 4dgs, means_lr: 1e-4}
scenes:
  robot: {data: dynamic/robot}
rules:
  - {rows: 3dgs, seeds: 7}
  - {rows: [4d*], scenes: robot, skip: no time}
columns: [psnr, ssim]
"""
PROJECT = """
[project]
name = "a-part"
[project.entry-points.gsfw]
part = "a_part.registration"
"""

Writer = Callable[[Path], str]
"""Writes files into a folder; gives the path in it that is read."""


def checkpoint(folder: Path) -> str:
    """A checkpoint of a few rows, with the nesting of real ones."""
    generator = torch.Generator().manual_seed(0)
    rows = {
        name: torch.randn(5, width, generator=generator) for name, width in (("means", 3), ("q", 4))
    }
    moments = {name: {"mean": value, "square": value**2} for name, value in rows.items()}
    state = {
        "model": rows,
        "optimizer": {"moments": moments, "steps": 20},
        "sampler": {"order": [2, 0, 1], "position": 1},
        "generators": {"cpu": generator.get_state()},
        "refiners": {"adc": {"count": torch.arange(5)}},
        "environment": {"threads": 1, "torch": str(torch.__version__), "instruction set": "scalar"},
    }
    return RunFolder(folder).write_checkpoint(20, state).relative_to(folder).as_posix()


def run(folder: Path) -> str:
    """A finished run: settings, figures, evaluations, messages, pictures, a checkpoint."""
    made = write_run(folder, {"a": 20.0, "b": 22.5, "c": 19.0}, steps=20)
    checkpoint(folder)
    floats = {"total_floats": 295, "sh_floats": 240, "sh_floats_full": 240, "groups": []}
    made.write_json(made.requirements, floats)
    measured = {"step_seconds": 0.01, "start_seconds": 1.0}
    made.write_json(made.plan, {"minutes": 1, "until": "", "measured": measured, "decided": {}})
    made.log.write_text(
        "2026-11-27 10:00:00,000 INFO note: 3 views to train on\n"
        "2026-11-27 10:00:01,000 WARNING the disk is nearly full\n"
    )
    home = folder / "report"
    home.mkdir()
    for name in ("00_target", "00_rendered", "00_error", "still"):
        Image.new("RGB", (8, 6), (20, 90, 200)).save(home / f"{name}.webp")
    view = {"name": "a", "label": "worst", "psnr": 20.0, "file": 0}
    pictures = {"schema": 1, "step": 20, "split": "eval", "error": "squared", "views": [view]}
    pictures |= {"still": True, "still_name": "a", "orbit": False, "is_moving": False}
    (home / "pictures.json").write_text(json.dumps(pictures))
    return "."


def config(folder: Path) -> str:
    """Settings of a run."""
    write_run(folder, {"a": 20.0}, steps=20)
    for path in folder.iterdir():
        if path.name != "config.yaml":
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    return "config.yaml"


def study(folder: Path) -> str:
    """A study with anchors, rules and columns."""
    (folder / "study.yaml").write_text(STUDY)
    return "study.yaml"


def results(folder: Path) -> str:
    """A result and a failure."""
    store = ResultStore(folder / "results.json", "A study")
    settings, figures = {"steps": 3, "method": "3dgs"}, {"psnr": 20.5, "steps": 3}
    store.keep(Result("a", "b", 1, "f", settings, settings, figures, {}, {}, "today"))
    store.keep(Failure("a", "b", 2, "It ended.", "Begin anew.", True))
    return "results.json"


def _poses() -> list[torch.Tensor]:
    return [torch.linalg.inv(torch.from_numpy(pose)) for pose in ring(3).poses]


def key_frames(folder: Path) -> str:
    """A path of key frames."""
    frames = tuple(KeyFrame(pose.float(), 50.0, 0.5, float(n)) for n, pose in enumerate(_poses()))
    write_camera_path(folder / "path.json", CameraPath(frames, 10.0, 2.0))
    return "path.json"


def nerfstudio_path(folder: Path) -> str:
    """A path of nerfstudio, and how it placed the world."""
    listed = [
        {"camera_to_world": pose.flatten().tolist(), "fov": 50, "render_time": 0.5}
        for pose in _poses()
    ]
    content = {"camera_path": listed, "fps": 24, "render_width": 64, "render_height": 48}
    (folder / "path.json").write_text(json.dumps(content))
    placed = {"scale": 0.5, "transform": torch.eye(4)[:3].tolist()}
    (folder / "dataparser_transforms.json").write_text(json.dumps(placed))
    return "path.json"


def transforms_path(folder: Path) -> str:
    """A path in the form of a data set."""
    listed = [{"transform_matrix": pose.tolist(), "time": 3.0} for pose in _poses()]
    content = {"frames": listed, "camera_angle_x": 0.9, "w": 64, "h": 48}
    (folder / "path.json").write_text(json.dumps(content))
    return "path.json"


def edits(folder: Path) -> str:
    """Steps of an edit."""
    steps = [{"edit": "crop.box", "value": "-1,-1,-1,1,1,1"}, {"edit": "scale", "value": "2"}]
    content = {"format": "gsfw edits", "version": 1, "input": "a.ply", "steps": steps}
    (folder / "a.edits.json").write_text(json.dumps(content))
    return "a.edits.json"


def work(folder: Path) -> str:
    """Notes of a preparation on what is done: stages, features, names of written files."""
    stage = {"key": ["a"], "finished": True, "seconds": 1.0, "result": {"count": 3}}
    (folder / "journal.json").write_text(json.dumps({"schema": 1, "stages": {"match": stage}}))
    names = ["images/a.png", "masks/a.png"]
    for name in names:
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        Image.new("L", (8, 6)).save(path)
    (folder / "work").mkdir()
    (folder / "work/written.txt").write_text("".join(f"{name}\n" for name in names))
    return "."


def frames(folder: Path) -> str:
    """The list of the frames of a film that was interrupted."""
    content = {"schema": 1, "request": {"names": ["0001.png"]}, "scales": {"depth": [0.5, 4.0]}}
    (folder / "frames.json").write_text(json.dumps(content))
    (folder / "0001.png").touch()
    return "."


def project(folder: Path) -> str:
    """The metadata of a package with plugins."""
    (folder / "pyproject.toml").write_text(PROJECT)
    return "pyproject.toml"


def owner(folder: Path) -> str:
    """The note on who holds a folder."""
    content = {"pid": 2**22 + 1, "host": "elsewhere", "since": "2026-11-27 10:00:00 UTC"}
    (folder / "gsfw.lock").write_text(json.dumps(content))
    return "gsfw.lock"


def events(folder: Path) -> str:
    """An event file of TensorBoard; its readers do not look at checksums."""
    from tensorboard.compat.proto.event_pb2 import Event

    path, parts = folder / "events.out.tfevents.1.host.1.0", []
    for step in range(4):
        event = Event(step=step, wall_time=1.0)
        event.summary.value.add(tag="loss", simple_value=0.5)
        content = event.SerializeToString()
        parts.append(struct.pack("<Q4x", len(content)) + content + bytes(4))
    path.write_bytes(b"".join(parts))
    return "."


RUN_FILES: Mapping[str, tuple[Writer, ...]] = {
    "config": (config,),
    "run folder": (run,),
    "checkpoint": (checkpoint,),
    "study": (study,),
    "results of a study": (results,),
    "camera path": (key_frames, nerfstudio_path, transforms_path),
    "edits": (edits,),
    "notes of a preparation": (work,),
    "frames of a film": (frames,),
    "package of a plugin": (project,),
    "owner of a folder": (owner,),
    "events": (events,),
}
"""Writers of sound files by the name of what reads them."""
