"""ModelHeader: the plain-data header of a model file; docs/guides/model-file.md describes it."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.column import Layout
from gsfw.core.datamanager import Split, Views
from gsfw.core.errors import DataError
from gsfw.core.exchange import StoredColumn, StoredModel
from gsfw.core.files.json_fields import BROKEN, JsonFields
from gsfw.core.maths.axes import stated_axis
from gsfw.core.maths.similarity import Similarity
from gsfw.core.numerics import PROFILES
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene

FORMAT = "gsfw model"
VERSION, PLAIN = 2, 1
"""Version of the layout; raised when an older gsfw could not read a newer file. Files whose arrays
are the state as it is are written in the version that every gsfw reads."""
CODED = "coded"
"""Field of the header that says how the state is stored; missing if it is stored as it is."""
STATE = "state/"
"""Folder of the arrays of the model's state."""


def write_header(model: StoredModel, coded: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """The header of a model file.

    Args:
        model: in the file.
        coded: how its state is stored; ``None`` as it is.
    """
    render, scene = model.render, model.scene
    return {
        "format": FORMAT,
        "version": PLAIN if coded is None else VERSION,
        "gsfw": version("gsfw"),
        "method": {
            "name": model.method,
            "distribution": model.distribution,
            "version": model.distribution_version,
        },
        "step": model.step,
        "rows": model.rows,
        "columns": {
            name: {
                "layout": column.layout.value,
                "values": STATE + column.values,
                "offsets": None if column.offsets is None else STATE + column.offsets,
            }
            for name, column in model.columns.items()
        },
        "scene": _scene_document(scene),
        "render": {
            "background": [0.0] * 3 if render.background is None else render.background.tolist(),
            "antialias": render.antialias,
            "near": render.near,
            "far": render.far,
            "profile": render.profile.name,
        },
        "settings": dict(model.settings),
        "splits": {split.value: views.origin for split, views in model.views.items()},
        **_maps_document(model.views[Split.TRAIN]),
        **({} if coded is None else {CODED: dict(coded)}),
        "cameras": [
            _camera_document(split, name, camera)
            for split, views in model.views.items()
            for name, camera in zip(views.names, views.cameras, strict=True)
        ],
    }


def _maps_document(views: Views) -> dict[str, Any]:
    """Channels of each per-view map: methods may make columns for them."""
    return {"maps": dict(views.maps)} if views.maps else {}


def _scene_document(scene: Scene) -> dict[str, Any]:
    frame = scene.world_from_scene
    return {
        "name": scene.name,
        "extent": scene.extent,
        "world_from_scene": {
            "scale": frame.scale,
            "rotation": frame.rotation.tolist(),
            "translation": frame.translation.tolist(),
        },
        "time_range": None if scene.time_range is None else list(scene.time_range),
        "num_times": scene.num_times,
        "has_alpha": scene.has_alpha,
        "up": scene.up,
    }


def _camera_document(split: Split, name: str, camera: Cameras) -> dict[str, Any]:
    def first(values: torch.Tensor | None) -> Any:  # noqa: ANN401 - a number, or a list
        return None if values is None else _shortest(values[0].tolist())

    return {
        "name": name,
        "split": split.value,
        "width": camera.width,
        "height": camera.height,
        "model": camera.model.value,
        "world_to_camera": first(camera.world_to_camera),
        "intrinsics": first(camera.intrinsics),
        "time": first(camera.time),
        "camera_index": first(camera.camera_index),
    }


def _shortest(value: Any) -> Any:  # noqa: ANN401 - a number, or a list
    """Numbers of float32 with the fewest digits that are read back as the same float32."""
    if isinstance(value, list):
        return [_shortest(item) for item in value]
    return float(str(np.float32(value))) if isinstance(value, float) else value


def read_header(
    path: Path, document: Mapping[str, Any], state: Mapping[str, torch.Tensor]
) -> StoredModel:
    """Build the model of a header and its tensors.

    Raises:
        DataError: this is no header of a model file, or one of a newer gsfw; names the place.
    """
    fields = JsonFields(path, "", document)
    _check_version(fields)
    views = _views(fields)
    method, render = fields.fields("method"), fields.fields("render")
    return StoredModel(
        method=method.text("name"),
        distribution=method.text("distribution"),
        distribution_version=method.text("version"),
        settings=_settings(fields.fields("settings")),
        step=fields.count("step"),
        rows=fields.count("rows"),
        scene=_scene(fields.fields("scene"), views),
        views=views,
        render=_render(render),
        columns=_columns(fields.fields("columns")),
        state=state,
    )


def _check_version(fields: JsonFields) -> None:
    if fields.values.get("format") != FORMAT:
        raise DataError(
            f"{fields.path} is no model file: expected format {FORMAT!r}, "
            f"found {fields.values.get('format')!r}.",
            "Give a file that gsfw export RUN format=gsfw has written.",
        )
    found = fields.count("version", least=1)
    if found > VERSION:
        raise DataError(
            f"{fields.path} is in version {found} of the format; this gsfw reads {VERSION}.",
            f"It was written by gsfw {fields.text('gsfw')}; this is {version('gsfw')}. "
            "Use that version to read it.",
        )


def _settings(fields: JsonFields) -> dict[str, Any]:
    """Read the settings: each is text, a number, true, false, nothing, or a list of these."""
    simple = str | int | float | bool | None
    for name, value in fields.values.items():
        if not all(
            isinstance(item, simple) for item in (value if isinstance(value, list) else [value])
        ):
            raise DataError(f"{fields.path}: setting {name} is a nested value.", BROKEN)
    return dict(fields.values)


def _scene(fields: JsonFields, views: Mapping[Split, Views]) -> Scene:
    frame = fields.fields("world_from_scene")
    times = None if fields.is_null("time_range") else fields.numbers("time_range", 2)
    centers = [camera.centers for camera in views[Split.TRAIN].cameras]
    return Scene(
        name=fields.text("name"),
        points=torch.zeros(0, 3),
        point_colors=torch.zeros(0, 3),
        camera_centers=torch.cat(centers) if centers else torch.zeros(0, 3),
        extent=fields.positive("extent"),
        world_from_scene=Similarity(
            frame.positive("scale"),
            torch.from_numpy(frame.numbers("rotation", 3, 3)),
            torch.from_numpy(frame.numbers("translation", 3)),
        ),
        time_range=None if times is None else (float(times[0]), float(times[1])),
        num_times=fields.count("num_times"),
        has_alpha=fields.flag("has_alpha"),
        up=stated_axis(fields.text("up")),
    )


def _render(fields: JsonFields) -> RenderSettings:
    profile = fields.text("profile")
    if profile not in PROFILES:
        raise DataError(
            f"{fields.path}: render.profile of its header: expected {', '.join(PROFILES)}, "
            f"found {profile!r}.",
            BROKEN,
        )
    return RenderSettings(
        background=torch.from_numpy(fields.numbers("background", 3)).float(),
        near=fields.positive("near"),
        far=fields.positive("far"),
        antialias=fields.flag("antialias"),
        profile=PROFILES[profile],
    )


def _columns(fields: JsonFields) -> dict[str, StoredColumn]:
    columns: dict[str, StoredColumn] = {}
    for name in fields.values:
        item = fields.fields(name)
        layout = item.text("layout")
        if layout not in {known.value for known in Layout}:
            raise DataError(f"{fields.path}: column {name} has the layout {layout!r}.", BROKEN)
        offsets = None if item.is_null("offsets") else item.text("offsets").removeprefix(STATE)
        columns[name] = StoredColumn(
            Layout(layout), item.text("values").removeprefix(STATE), offsets
        )
    return columns


def _views(fields: JsonFields) -> dict[Split, Views]:
    found: dict[Split, list[tuple[str, Cameras]]] = {split: [] for split in Split}
    for item in fields.objects("cameras"):
        named = item.text("split")
        if named not in {split.value for split in Split}:
            raise DataError(f"{fields.path}: {item.where} is of the split {named!r}.", BROKEN)
        found[Split(named)].append((item.text("name"), _camera(item)))
    if not found[Split.TRAIN]:
        raise DataError(f"{fields.path}: its header has no cameras that it was trained on.", BROKEN)
    origins = fields.fields("splits")
    maps = fields.fields("maps", default={})
    channels = {name: maps.count(name, least=1) for name in maps.values}
    return {
        split: Views(
            tuple(name for name, _ in members),
            tuple(camera for _, camera in members),
            origins.text(split.value),
            channels,
        )
        for split, members in found.items()
    }


def _camera(fields: JsonFields) -> Cameras:
    model = fields.text("model")
    if model not in {known.value for known in CameraModel}:
        raise DataError(f"{fields.path}: {fields.where} has the model {model!r}.", BROKEN)

    def tensor(name: str, *shape: int) -> torch.Tensor:
        return torch.from_numpy(fields.numbers(name, *shape))[None].float()

    def index(name: str) -> torch.Tensor | None:
        return None if fields.is_null(name) else torch.tensor([fields.count(name)])

    return Cameras(
        world_to_camera=tensor("world_to_camera", 4, 4),
        intrinsics=tensor("intrinsics", 3, 3),
        width=fields.count("width", least=1),
        height=fields.count("height", least=1),
        model=CameraModel(model),
        time=None if fields.is_null("time") else tensor("time"),
        camera_index=index("camera_index"),
    )
