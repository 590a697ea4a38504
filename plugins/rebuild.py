"""Rebuild: converts a run to a stored model, and a stored model to a run without its data set.

The model is built by its method's own ``build_model``, for a scene with a few substitute points;
the stored state then replaces its rows. So the full ``state_dict`` of a method is restored, and a
method needs no code for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from gsfw.core.column import Column, Layout
from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.exchange import StoredColumn, StoredModel
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.model import PrimitiveModel
from gsfw.core.scene import Scene
from gsfw.plugins.automatic import BUILT_IN_SCENE
from gsfw.plugins.compose import Composition, compose
from gsfw.plugins.config_file import PLACES
from gsfw.plugins.keys import SLOT_KEYS
from gsfw.plugins.registry import Registry
from gsfw.plugins.restore import Restored
from gsfw.plugins.settings import Layer, resolve
from gsfw.plugins.stored_capture import StoredCapture

LOCAL = (*PLACES, "out", "device", "callbacks")
"""Settings and groups that are valid on one machine only; a stored model has none of them."""
NO_STRATEGY = "none"
"""The strategy that keeps the rows as they are."""
STAND_INS = 64
"""Number of substitute points: enough for methods that need neighbours."""
SAME_FRAME = 1e-5
"""Largest difference of two equal scene frames, in extents."""
OTHER_VERSION = "Use the version of gsfw, and of the method's package, that wrote it."


def stored_model(restored: Restored) -> StoredModel:
    """The state of a restored run that rendering needs.

    Raises:
        ValueError: the model has state that is no tensor; names it.
    """
    composition = restored.composition
    parts, settings = composition.parts, composition.settings
    scene, none = parts.data.scene, torch.zeros(0, 3)
    return StoredModel(
        method=settings.method.name,
        distribution=settings.method.distribution,
        distribution_version=settings.method.version,
        settings={
            key: value
            for key, value in settings.flat().items()
            if key.partition(".")[0] not in LOCAL
        },
        step=restored.step,
        rows=parts.model.num_rows,
        scene=replace(scene, points=none, point_colors=none, point_times=None),
        views={split: parts.data.views(split) for split in Split},
        render=composition.plan.settings,
        columns={
            name: StoredColumn(
                column.layout,
                f"{place}.values",
                f"{place}.offsets" if column.layout is Layout.RAGGED else None,
            )
            for name, (place, column) in _columns(parts.model).items()
        },
        state=_tensors(parts.model),
    )


def _tensors(model: PrimitiveModel) -> Mapping[str, Tensor]:
    state = model.state_dict()
    for name, value in state.items():
        if not isinstance(value, Tensor):  # A module's extra state may be anything.
            raise ValueError(f"its {name} is no tensor but a {type(value).__name__}")
    return state


def _columns(model: PrimitiveModel) -> dict[str, tuple[str, Column]]:
    """Columns by name, and the path of each among the model's modules."""
    places = {id(module): place for place, module in model.named_modules()}
    return {name: (places[id(column)], column) for name, column in model.columns().items()}


def rebuild(
    stored: StoredModel, path: Path, registry: Registry, changed: Layer | None = None
) -> Restored:
    """Compose a run around a stored model.

    It renders the same images as the run. It has images to compare with if ``changed`` names the
    data set; otherwise it has the capture's cameras alone.

    Args:
        stored: the model.
        path: the file of the model.
        registry: the installed parts.
        changed: settings that replace the run's own.

    Raises:
        DataError: the method is not installed, or its model is not the stored one.
        ConfigError: the settings no longer resolve.
    """
    _check_installed(stored, path, registry)
    with_data = changed is not None and "data" in changed.values
    values = {
        key: value
        for key, value in stored.settings.items()
        if key.partition(".")[0] not in (*LOCAL, "rasterizer")
        and (with_data or key.partition(".")[0] not in SLOT_KEYS)
    }
    if stored.settings.get("strategy") == NO_STRATEGY:
        # Models that cannot be densified refuse every other strategy.
        values["strategy"] = NO_STRATEGY
    packages = (_package(stored),)
    layers = [Layer(f"model file {path}", values, packages=packages)]
    layers += [changed] if changed else []
    settings = resolve(registry, layers)
    if with_data:
        composition = compose(settings, registry, restoring=True)
        _check_frame(stored.scene, composition, path)
    else:
        has_data = stored.settings.get("datamanager") != BUILT_IN_SCENE
        capture = StoredCapture(_with_points(stored.scene), stored.views, str(path), has_data)
        composition = compose(settings, registry, restoring=True, data=capture)
    load_state(composition.parts.model, stored, path)
    state = {"step": stored.step, "model": dict(stored.state)}
    return Restored(RunFolder(path.parent), composition, state)


def _check_installed(stored: StoredModel, path: Path, registry: Registry) -> None:
    try:
        registry.find("method", stored.method, (_package(stored),))
    except ConfigError as error:
        raise DataError(f"{path} cannot be opened: {error.message}", error.advice) from error


def _package(stored: StoredModel) -> str:
    """The package of the method: "gsfw-dots 0.3"."""
    return f"{stored.distribution} {stored.distribution_version}".strip()


def _with_points(scene: Scene) -> Scene:
    """Add points to build a model on, so that nothing starts at random."""
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(STAND_INS, 3, generator=generator) - 0.5
    colors = torch.full((STAND_INS, 3), 0.5)
    return replace(scene, points=scene.extent * points, point_colors=colors)


def _check_frame(scene: Scene, composition: Composition, path: Path) -> None:
    """Refuse a data set whose scene frame differs from that of the model.

    Raises:
        DataError: it is another data set, or its cameras were estimated again.
    """
    now = composition.scene.world_from_scene
    probes = torch.cat([torch.zeros(1, 3), torch.eye(3)]).double() * scene.extent
    before, after = scene.world_from_scene.apply(probes), now.apply(probes)
    far = float((before - after).abs().max())
    if not far <= SAME_FRAME * scene.extent * scene.world_from_scene.scale:
        raise DataError(
            f"{path} was not trained on data={composition.settings.config.data}: places in it "
            f"lie {far:.3g} apart from where the model has them.",
            "Give the data set that it was trained on, with the cameras of that time.",
        )


def load_state(model: PrimitiveModel, stored: StoredModel, path: Path) -> None:
    """Check that a stored state fits a model of its method, then load it.

    Raises:
        DataError: a tensor is missing, unexpected, or of another type or shape; names it.
    """
    own = model.state_dict()
    for name in sorted(own.keys() - stored.state.keys()):
        raise _unfit(path, f"it has no state {name}, which method {stored.method!r} needs")
    for name in sorted(stored.state.keys() - own.keys()):
        raise _unfit(path, f"method {stored.method!r} does not know its state {name}")
    columns = _columns(model)
    stacked = {f"{place}.values" for place, c in columns.values() if c.layout is Layout.STACKED}
    for name, tensor in stored.state.items():
        axes = 2 if name in stacked else 1
        fits = tensor.dim() == own[name].dim() and tensor.shape[axes:] == own[name].shape[axes:]
        if not fits or tensor.dtype != own[name].dtype:
            raise _unfit(
                path,
                f"its {name} is {_shown(tensor)}; the model of method {stored.method!r} has "
                f"{_shown(own[name])}",
            )
    for name, (place, column) in columns.items():
        rows = _count_rows(path, name, column.layout, place, stored.state)
        if rows != stored.rows:
            raise _unfit(path, f"column {name} has {rows} rows, and the model {stored.rows}")
    try:
        model.load_state_dict(stored.state)
        _try_out(model)
    except (RuntimeError, IndexError, ValueError) as error:
        raise _unfit(path, " ".join(str(error).split()).rstrip(".")) from error


@torch.no_grad()
def _try_out(model: PrimitiveModel) -> None:
    """Compute splats, so that contradictions in a state raise an error now."""
    for time in (0.0, 1.0):
        device = next(iter(model.columns().values())).values.device
        model.splats(torch.tensor(time, device=device))


def _count_rows(
    path: Path, name: str, layout: Layout, place: str, state: Mapping[str, Tensor]
) -> int:
    """Count the rows of a stored column.

    Raises:
        DataError: it is ragged, and its offsets contradict its values.
    """
    values = state[f"{place}.values"]
    if layout is not Layout.RAGGED:
        return values.shape[1 if layout is Layout.STACKED else 0]
    offsets = state[f"{place}.offsets"]
    sound = len(offsets) > 0 and int(offsets[0]) == 0 and int(offsets[-1]) == len(values)
    if not sound or bool((offsets.diff() < 0).any()):
        raise _unfit(path, f"the offsets of column {name} do not fit its {len(values)} values")
    return len(offsets) - 1


def _unfit(path: Path, problem: str) -> DataError:
    return DataError(f"{path} cannot be drawn: {problem}.", OTHER_VERSION)


def _shown(tensor: Tensor) -> str:
    kind = str(tensor.dtype).removeprefix("torch.")
    return f"{kind} of shape {tuple(tensor.shape)}"
